"""CAN: frames, the model of the bus, the buses of python-can.  Import the modules; this file stays empty."""
