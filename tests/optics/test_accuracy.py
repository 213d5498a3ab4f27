from dataclasses import dataclass

import pytest

from optics.accuracy import (
    Account,
    Budget,
    ErrorEstimate,
    MachineSpeed,
    ToleranceError,
    cheapest,
    describe,
)


@dataclass
class Way:
    name: str
    bytes: int
    cost: float

    def cpu_seconds(self, speed: MachineSpeed) -> float:
        return self.cost * speed.fft


QUICK, THRIFTY = Way("quick", 2_000_000_000, 1.0), Way("thrifty", 3_000_000, 9.0)


def test_the_cheapest_way_is_chosen():
    assert cheapest([THRIFTY, QUICK], Budget(), "it") is QUICK


def test_what_does_not_fit_in_memory_is_passed_over():
    assert cheapest([QUICK, THRIFTY], Budget(memory=4_000_000), "it") is THRIFTY


def test_if_nothing_fits_the_memory_of_the_thriftiest_is_named():
    with pytest.raises(
        ToleranceError, match=r"a hologram needs 3 MB at least and 2 MB are allowed; allow more"
    ):
        cheapest([QUICK, THRIFTY], Budget(memory=2_000_000), "a hologram")


def test_an_account_adds_sampling_and_arithmetic_and_keeps_the_model_apart():
    account = Account(
        "way", "2x2", "float32", 1e-3, ErrorEstimate(0.5, "estimate"),
        ErrorEstimate(1e-4, "bound"), ErrorEstimate(2e-6, "measured"), 0.25, 10,
    )  # fmt: skip
    assert account.error == pytest.approx(1.02e-4)
    data = describe(account.spent(0.125))
    assert data["error_predicted"] == pytest.approx(1.02e-4)
    assert (data["error_sampling"], data["error_sampling_how"]) == (1e-4, "bound")
    assert (data["error_arithmetic"], data["error_arithmetic_how"]) == (2e-6, "measured")
    assert data["error_model"] == 0.5
    assert (data["cpu_predicted_s"], data["cpu_s"]) == (0.25, 0.125)
    assert account.cpu_spent is None
