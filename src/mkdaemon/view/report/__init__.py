"""A flight as one page that needs no network: figures out of a recording, and the page that shows them."""
