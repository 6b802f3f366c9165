"""One file per optimizer, all driven by ask and tell."""
