"""The console: a page of plain ES modules without a build step; `assets` hands its files out."""
