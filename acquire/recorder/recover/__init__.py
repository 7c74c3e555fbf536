"""Recovery of recordings that were cut short or damaged, and additions to complete ones."""
