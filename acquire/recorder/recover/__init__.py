"""Recovery of recordings that were cut short, and editing of whole ones."""
