"""What people look at: the page in the browser, the terminal view, the report."""
