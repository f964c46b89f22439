"""glTF, with its buffers in one file or in several."""
