"""The one parser of typed numbers, and that the whole command line goes through it."""

from __future__ import annotations

import random

import pytest
from figures.typed_options import command_line_places, judge_lists, judge_places, list_places

from labapp.cli import build_command_line
from labapp.cli.number_options import number_parameters
from labapp.common.errors import UserError
from labapp.common.typed_numbers import parse_list, parse_number, parse_whole


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("0.5", 0.5), ("0,5", 0.5), ("1.234", 1.234), ("1,234", 1.234), ("1e3", 1000.0),
        ("2,5E-3", 0.0025), (" 7\u00a0", 7.0), (".5", 0.5), ("5,", 5.0), ("−3", -3.0),
        ("+4", 4.0), ("5 ms", 5.0), ("5ms", 5.0), ("007", 7.0),
    ],
)  # fmt: skip
def test_a_point_or_a_comma_is_the_decimal_sign(text, number):
    assert parse_number(text, "ms") == number


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("1,234.5", "both a point and a comma"), ("1.234.567", "several signs"),
        ("1 234", "several signs"), ("1\u202f234", "several signs"), ("1'234", "several signs"),
        ("1_000", "several signs"), ("٥", "another script"), ("１", "another script"),
        ("0x10", "'x10' after its number"), ("5 s", "type the number of ms alone"),
        ("nan", "isn't a number"), ("inf", "isn't a number"), ("", "no number"),
        ("1e999", "beyond"), ("1e-999", "beyond"), ("1e9999999", "beyond"), ("9" * 500, "9"),
        ("½", "another script"), ("1e", "'e' after its number"), ("--1", "isn't a number"),
    ],
)  # fmt: skip
def test_all_else_is_refused_by_what_is_wrong(text, words):
    with pytest.raises(ValueError) as told:
        parse_number(text, "ms")
    assert words in str(told.value)


def test_whole_numbers_keep_all_their_digits():
    assert parse_whole("1e3") == 1000
    assert parse_whole("12345678901234567890123456789012345") == 12345678901234567890123456789012345
    with pytest.raises(ValueError, match="isn't a whole number"):
        parse_whole("2.5")


def test_lists_are_read_by_semicolons_or_by_commas():
    assert parse_list("1,8,64") == [1, 8, 64]
    assert parse_list("0,5; 1,5") == [0.5, 1.5]
    assert parse_list("0.5,8") == [0.5, 8]
    assert parse_list("0,5", 2) == [0, 5]
    for text in ("12,5", "0,5", "1.234,5", "1,234.5"):
        with pytest.raises(ValueError, match="may be one number or two"):
            parse_list(text)
    with pytest.raises(ValueError, match="has 3 numbers, and must have 2"):
        parse_list("1,2,3", 2)


def test_every_number_of_the_command_line_is_set_as_typed_or_refused():
    ours = {
        (" ".join(words), one.opts[0]) for words, one, _ in number_parameters(build_command_line())
    }
    walked = {tuple(name.rsplit(" ", 1)) for name, *_ in command_line_places()}
    assert ours == walked
    assert len(walked) > 100
    rng = random.Random(7)
    for found in (judge_places(rng, 15), judge_lists(rng, 10)):
        assert set(found["fates"]) <= {"set", "kept"}, found["wrong"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["beam", "--distance", "1,5.0"], "--distance '1,5.0' has both a point and a comma"),
        (["psf", "--size", "2,5"], "--size '2,5' isn't a whole number"),
        (["pattern", "lens", "focal_length_m=2_0"], "key 'focal_length_m': '2_0' has several"),
        (["pattern", "lens", "focal_length_m=1.000,5"], "has both a point and a comma"),
    ],
)
def test_a_number_that_cannot_be_read_is_named_by_its_option(labapp, words, message):
    code, _, said = labapp(*words)
    assert code == 1
    assert message in said


def test_every_list_option_takes_commas_with_blanks_and_refuses_blanks_alone():
    for name, _, size, take in list_places():
        # Bands are some hundred nanometres, and the indices of Zernike small.
        numbers = ("450", "550", "650")[:size] if name == "--bands" else ("2", "4", "20")[:size]
        for sound in (", ", ";", "; ", " ; "):
            taken = list(take(sound.join(numbers)))
            assert taken == pytest.approx([float(one) for one in numbers]), (name, sound)
        with pytest.raises((UserError, ValueError), match="put semicolons between numbers"):
            take(" ".join(numbers))
        if size == 3:
            with pytest.raises((UserError, ValueError), match="may be decimal signs"):
                take("{},{}, {}".format(*numbers))
