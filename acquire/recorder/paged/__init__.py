"""Writing through the kernel's page cache: frames are copied into a buffer pool, a thread writes them."""
