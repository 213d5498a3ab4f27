"""Decode captures of an extended depth of field by a network over a linear filter.

`DecoderNetwork` refines what a filter made of a capture; `learned_decoder` makes it a decoder for
`optics.edof.evaluate_patterns`. `CaptureFilter` is the filter for captures of any size.
"""

from optics.edof.learned.decoder_network import DecoderNetwork, DecoderSettings, learned_decoder
from optics.edof.learned.u_net import NetworkShape, UNet
from optics.edof.learned.wiener_front import CaptureFilter, WienerFront

__all__ = [
    "CaptureFilter",
    "DecoderNetwork",
    "DecoderSettings",
    "NetworkShape",
    "UNet",
    "WienerFront",
    "learned_decoder",
]
