"""The fleet: plants, what their scans found over weeks, tracks, alarms, schedules. The mathematics is `monitoring`."""
