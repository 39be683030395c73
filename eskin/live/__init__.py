"""The live view: sources of frames and stages, the hub that thins them out for the eye, the browser page's
server."""
