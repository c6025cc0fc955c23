"""Many aircraft on Zenoh routers: a link that is cut, and what each aircraft costs."""
