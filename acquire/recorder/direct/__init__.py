"""Writing past the page cache: aligned memory, borrowed camera buffers, O_DIRECT."""
