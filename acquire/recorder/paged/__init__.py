"""Writing through the kernel's page cache: frames are copied into a pool, a thread writes them."""
