"""Results as HTML pages in one file each: no network, no other files."""
