"""`python -m tinyekf_py.vehicle`."""

import sys

from tinyekf_py.vehicle.command import main

sys.exit(main())
