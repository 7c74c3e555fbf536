"""`analyze register`: poses of an object's markers from its recorded strikes."""
