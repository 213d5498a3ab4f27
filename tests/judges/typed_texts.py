"""Texts that people type for numbers, drawn by rules, with the number that each stands for."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal

SCRIPTS = {"Arabic": 0x660, "Persian": 0x6F0, "Devanagari": 0x966, "full width": 0xFF10}
GROUPS = (" ", "\u00a0", "\u202f", "'", "’", "_")


@dataclass(frozen=True)
class Typed:
    """A text, and the number that it stands for; None if it must be refused.

    is_sound: whether nobody could take the text for another number, so that it must be read.
    """

    text: str
    number: Decimal | None
    rule: str
    is_sound: bool = False


@dataclass(frozen=True)
class Field:
    """What a field takes: a range, decimals (None for any), and a unit."""

    low: Decimal
    high: Decimal
    decimals: int | None
    unit: str = ""

    def draw(self, rng: random.Random) -> Decimal:
        """A number that the field can hold, all decades of its range alike."""
        places = min(rng.randint(0, 3), 3 if self.decimals is None else self.decimals)
        step = Decimal(1).scaleb(-places)
        top = min(self.high, Decimal(10) ** rng.randint(0, 6))
        bottom = max(self.low, Decimal(0)) if rng.random() < 0.8 else self.low
        drawn = Decimal(rng.uniform(float(bottom), float(max(top, bottom))))
        return min(max(drawn.quantize(step), self.low), self.high)

    def holds(self, number: Decimal) -> bool:
        fits = self.decimals is None or round(number, self.decimals) == number
        return fits and self.low <= number <= self.high


def draw_texts(field: Field, rng: random.Random, count: int) -> list[Typed]:
    """As many texts, of each rule about as many."""
    rules = list(_RULES.items())
    rng.shuffle(rules)
    texts = []
    for k in range(count):
        name, rule = rules[k % len(rules)]
        text, number, is_sound = rule(field.draw(rng), field, rng)
        sound = is_sound and number is not None and field.holds(number)
        texts.append(Typed(text, number, name, sound))
    return texts


Rule = Callable[[Decimal, Field, random.Random], tuple[str, Decimal | None, bool]]


def _point(number: Decimal, field: Field, rng: random.Random) -> tuple[str, Decimal, bool]:
    return f"{number:f}", number, True


def _comma(number: Decimal, field: Field, rng: random.Random) -> tuple[str, Decimal, bool]:
    return f"{number:f}".replace(".", ","), number, True


def _exponent(number: Decimal, field: Field, rng: random.Random) -> tuple[str, Decimal, bool]:
    power = rng.randint(-3, 3)
    text = (
        f"{number.scaleb(-power):f}{rng.choice('eE')}{rng.choice(['', '+']) if power > 0 else ''}"
    )
    return f"{text}{power}".replace(".", rng.choice(".,")), number, True


def _bare_sign(number: Decimal, field: Field, rng: random.Random) -> tuple[str, Decimal, bool]:
    whole = Decimal(int(number))
    if rng.random() < 0.5:
        return f"{whole}{rng.choice('.,')}", whole, False
    part = abs(number) - int(abs(number))
    return f"{rng.choice('.,')}{f'{part:f}'.partition('.')[2] or '0'}", part, False


def _surrounded(number: Decimal, field: Field, rng: random.Random) -> tuple[str, Decimal, bool]:
    blank = rng.choice([" ", "  ", "\u00a0"])
    return f"{blank}{number:f}{blank}", number, True


def _signed(number: Decimal, field: Field, rng: random.Random) -> tuple[str, Decimal, bool]:
    sign = rng.choice("+-−")
    return f"{sign}{abs(number):f}", abs(number) if sign == "+" else -abs(number), False


def _right_unit(number: Decimal, field: Field, rng: random.Random) -> tuple[str, Decimal, bool]:
    return f"{number:f}{rng.choice(['', ' '])}{field.unit}", number, not field.unit


def _other_unit(
    number: Decimal, field: Field, rng: random.Random
) -> tuple[str, Decimal | None, bool]:
    units = [one for one in ("s", "m", "µm", "Hz", "kg", "%") if one != field.unit]
    return f"{number:f} {rng.choice(units)}", None, False


def _finer(number: Decimal, field: Field, rng: random.Random) -> tuple[str, Decimal, bool]:
    fine = number + Decimal(rng.randint(1, 9)).scaleb(-rng.randint(4, 7))
    return f"{fine:f}".replace(".", rng.choice(".,")), fine, False


def _beyond(number: Decimal, field: Field, rng: random.Random) -> tuple[str, Decimal, bool]:
    far = rng.choice([field.low - abs(number) - 1, field.high + abs(number) + 1])
    return f"{far:f}", far, False


def _grouped(number: Decimal, field: Field, rng: random.Random) -> tuple[str, None, bool]:
    sign = rng.choice(GROUPS)
    return f"{rng.randint(1, 999)}{sign}{rng.randint(0, 999):03}", None, False


def _many_groups(number: Decimal, field: Field, rng: random.Random) -> tuple[str, None, bool]:
    sign = rng.choice(".,")
    return sign.join(["1", *(f"{rng.randint(0, 999):03}" for _ in range(2))]), None, False


def _both_signs(number: Decimal, field: Field, rng: random.Random) -> tuple[str, None, bool]:
    first, second = rng.sample(".,", 2)
    return (
        f"{rng.randint(1, 9)}{first}{rng.randint(0, 999):03}{second}{rng.randint(0, 9)}",
        None,
        False,
    )


def _script(number: Decimal, field: Field, rng: random.Random) -> tuple[str, None, bool]:
    zero = rng.choice(list(SCRIPTS.values()))
    digits = {ord("0") + k: zero + k for k in range(10)} | {ord("."): rng.choice(".,٫")}
    return f"{number:f}".translate(digits), None, False


def _word(number: Decimal, field: Field, rng: random.Random) -> tuple[str, None, bool]:
    words = [
        "nan",
        "inf",
        "-inf",
        "0x10",
        "five",
        "",
        "-",
        "1e",
        "e3",
        "1e1.5",
        "--2",
        "1/2",
        "1;2",
    ]
    return (
        rng.choice([*words, "1 000,5", "5 5", "½", "2³", "1e999", "1e-999", "1d2", "0b1"]),
        None,
        False,
    )


_RULES: dict[str, Rule] = {
    "point": _point,
    "comma": _comma,
    "exponent": _exponent,
    "bare sign": _bare_sign,
    "blanks around": _surrounded,
    "signed": _signed,
    "right unit": _right_unit,
    "other unit": _other_unit,
    "finer than the field": _finer,
    "beyond its range": _beyond,
    "one group sign": _grouped,
    "several signs": _many_groups,
    "both signs": _both_signs,
    "another script": _script,
    "no number": _word,
}


def fate(typed: Typed, before: float, after: float, told: bool) -> str:
    """How a field took a text: set, kept, or a fault in words.

    before, after: numbers that the field had and has; told: whether it said that it refused.
    """
    if typed.number is not None and float(typed.number) == after:
        return "set"
    if after != before:
        return "set to something else"
    if typed.is_sound:
        return "sound, but refused"
    return "kept" if told else "kept without a word"
