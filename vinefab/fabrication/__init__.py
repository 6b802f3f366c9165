"""From a design to a checked fabrication package; never loads the simulator."""
