"""Numbers and units as an engineer writes them."""

from symfive.numbers import (
    change,
    expected_ratio,
    in_words,
    name_words,
    percent,
    plain_number,
    power_of_ten,
    rounded,
    unit_words,
    with_std,
)


def test_numbers_and_units_as_engineers_write_them():
    assert unit_words("um") == "µm" and unit_words("urad/deg") == "µrad/°" and unit_words("um/(m/s^2)") == "µm/(m/s²)"
    assert name_words("ppm", "ppm") == "" and name_words("lag_ms", "ms") == "lag"
    assert rounded(0.5, 0.0996) == "0.50" and rounded(0.0996, 0.0996) == "0.10"
    assert rounded(12.3456, 0.047) == "12.346" and rounded(-1234.5, 210.0) == "−1230" and rounded(-0.001, 5.0) == "0.0"
    assert plain_number(0.4) == "0.4" and plain_number(-37.04) == "−37" and plain_number(2e7) == "2.00e+07"
    assert plain_number(1.3e-15) == "0" and plain_number(-3e-5, "um") == "0" and plain_number(3e-5) == "3.00e−05"
    assert rounded(-4e-16, 3e-15) == "0" and rounded(1e-15, 0.0, "um") == "0" and rounded(-0.0004, 0.02) == "0.000"
    assert with_std(8.9031, 0.0612, "um") == "8.903 ± 0.061 µm" and with_std(0.5, 0.0, "1") == "0.5"


def test_small_numbers_in_words():
    assert change(1.6712, 0.40212, "um") == "1.67 → 0.402" and change(0.4021, 0.4022, "um") == "0.402"
    assert in_words("EZB") == "EZB" and in_words(("B", "C")) == "B, C"
    assert in_words(7.0123, 0.064, "um") == "7.012 ± 0.064 µm"
    assert in_words((0.0, 0.27712), (0.01, 0.004), "1") == "(0.000 ± 0.010, 0.2771 ± 0.0040)"
    assert in_words((0.0, 4e-14, 1.0), (0.0, 1.7e-12, 3e-11), "1") == "(0, 0, 1)"  # one direction is read
    assert in_words(7.01, 2e-9, "um") == "7.01 µm"
    matrix, spreads = ((1.0, 0.0123), (-0.2, 1.0)), ((0.01, 0.01), (0.1, 0.1))
    assert in_words(matrix, spreads, spread=False) == "((1.000, 0.012), (−0.20, 1.00))"
    assert percent(0.9999) == "above 99.9 %" and percent(0.5) == "50 %" and percent(0.0) == "0 %"
    assert [power_of_ten(p) for p in (0.03, 3e-7, 1e-300)] == ["0.03", "about 10⁻⁷", "below 10⁻³⁰⁰"]


def test_the_band_of_chi_squared_and_few_degrees_of_freedom():
    assert expected_ratio(800.0) == "noise alone gives 1 ± 0.1"
    assert expected_ratio(8.0) == "noise alone gives 1 ± 1; with 8 degrees of freedom it says little"
    assert "no degree of freedom" in expected_ratio(0.2)
