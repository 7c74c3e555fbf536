"""From poses to phi and k."""
