"""Where an object's markers are glued: found from how it rested and over which edges it tipped."""
