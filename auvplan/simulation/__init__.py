"""The truth that a mission meets: the sea, its obstacles and the vehicle, in steps of time."""
