"""The recording format and the documents that acquire and analyze hand each other. Imports nothing of ours."""
