"""The fleet: plants, what their scans found over weeks, tracks, alarms, schedules. SQL; the mathematics is `monitoring`."""
