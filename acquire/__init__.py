"""The hardware daemon: drives striker and camera, stamps frames and strikes, writes the recording."""
