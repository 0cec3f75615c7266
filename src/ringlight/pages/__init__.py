"""Pages for a browser: one file each, which opens from a disk and loads nothing."""
