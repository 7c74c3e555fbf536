"""One camera frame and the page-aligned memory that it lies in, shared by camera and recorder."""
