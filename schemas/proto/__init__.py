"""Protobuf messages of recordings: percuss.proto, from which `make protos` generates percuss_pb2."""
