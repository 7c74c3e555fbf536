"""One camera frame and the page-aligned memory that holds its pixels, shared by camera and recorder."""
