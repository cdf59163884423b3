"""Hard cases as data, what is measured for each, and the report of ``glossy stability``."""
