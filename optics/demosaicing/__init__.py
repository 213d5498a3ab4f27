"""All colours of each pixel, from a sensor whose pixels see one each."""

from optics.demosaicing.demosaic import METHODS as METHODS
from optics.demosaicing.demosaic import Method as Method
from optics.demosaicing.demosaic import demosaic as demosaic
