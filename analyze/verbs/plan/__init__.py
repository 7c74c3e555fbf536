"""`analyze plan`: object file, rig file and earlier results in, strike plan out."""
