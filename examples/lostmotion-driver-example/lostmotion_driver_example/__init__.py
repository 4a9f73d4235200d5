"""A robot whose controller sends its state as UDP datagrams: a driver for lostmotion in a package of its own."""
