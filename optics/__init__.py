"""Model light, modulators, lenses, sensors and their inverses, as functions on tensors.

Import what you need from each module. This package doesn't depend on files, devices or windows,
and importing it loads nothing else.
"""

import sys

from optics.moved import MovedModules

# First, for a folder that an old module left behind is a module, too, though an empty one.
sys.meta_path.insert(0, MovedModules())
