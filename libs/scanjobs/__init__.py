"""What a scan job is: its states, plan, rows, leases and artifacts. Knows SQL and the queue, never the science."""
