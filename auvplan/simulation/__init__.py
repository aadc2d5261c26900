"""The truth that a mission meets: current, obstacles and the vehicle, in steps of time."""
