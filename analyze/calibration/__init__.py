"""From views of a board to a camera: its lens, how well it is known, and where the camera stands."""
