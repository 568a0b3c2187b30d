"""Runs the command ``eyebox`` as ``python -m eyebox``."""

import sys

from ._command import main

sys.exit(main())
