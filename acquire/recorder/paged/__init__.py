"""Writing of recordings through the kernel's page cache: frames are copied, and a thread writes them."""
