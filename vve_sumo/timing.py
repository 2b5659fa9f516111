"""The times by which setpoints, reports and the gateway's steps are kept in step with each other [s].

Each is said here once; tests/test_timing.py holds how they depend on each other. Knows nothing else of the program.
"""

from __future__ import annotations

from typing import Final

#: of a tick, and of a step of the gateway: 50 Hz, the rate at which the DBW controller expects commands
PERIOD: Final = 0.02

#: how long a setpoint may be acted on. As long as the DBW controller waits for a command by itself: four ticks may be
#: lost, and the last setpoint is not acted on for longer than the car would act on the last command.
SETPOINT_LIFETIME: Final = 0.1

# Time between two steps of the gateway's process, in periods. An early setpoint waits for MIN, so that the DBW
# controller never gets two commands at once. A late one is waited for until MAX, so that a tick that is up to half a
# period late is still sent at once; but after a step without a setpoint only for LONE, the period.
MIN_STEP_INTERVAL: Final = 0.5
LONE_STEP_INTERVAL: Final = 1.0
MAX_STEP_INTERVAL: Final = 1.5

#: how much later at most the gateway's next step finds what has become true, such as an expired setpoint
NOTICED: Final = MAX_STEP_INTERVAL * PERIOD

#: age of a report that comes at 50 or 100 Hz from which on it counts as missing: five or ten periods of it
MAX_REPORT_AGE: Final = 0.1
#: the same of the gear, which comes at 20 Hz: four periods
MAX_GEAR_REPORT_AGE: Final = 0.2
#: age of wheel speeds up to which they show that the car stands now: three steps of the gateway. An older zero may be
#: of a car that has begun to roll, and no shift to park is requested on it.
MAX_PARK_REPORT_AGE: Final = 3 * PERIOD
