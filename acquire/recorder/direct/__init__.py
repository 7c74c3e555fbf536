"""Writing of recordings past the kernel's page cache (O_DIRECT), from the camera's own buffers."""
