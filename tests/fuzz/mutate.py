"""Mutations that know what numbers, strings and lines are: what all formats of symfive consist of."""

import random
import re

TOKEN = re.compile(rb'"[^"\n]*"|[-+]?[0-9][0-9.eE_+-]*|\w+|\n|[^\S\n]+|[^\n]', re.ASCII)
NUMBERS = (
    *b"0 -0.0 1 -1 2 60 61 255 1000000 0.5 -0.5 1e-9 5e-324 1e-300 1e150 1e308 -1e308 1e400 nan inf -inf +nan 1_0".split(),
    *b"0x10 9007199254740993 9223372036854775807 -9223372036854775809 1e 1. .5 --1 true false".split(),
    b"9" * 400, b"9" * 5000,
)  # fmt: skip
STRINGS = (
    b'""', b'" "', b'"X"', b'"C"', b'"a"', b'"a.csv"', b'"./a.csv"', b'"b.csv"', b'"../x"', b'"/etc/passwd"',
    b'"sub/../a.csv"', b'"A.CSV"', b'"./machine.toml"', b'"campaign.toml."', b'"CON"', b'"C:x.csv"', b'"a\\nb"',
    b'"\\u0000"', b'"\\ud800"', b'"\\u2028"', b'"%s{0}"', b'"' + "ä".encode() * 300 + b'"',
    b"[]", b"{}", b"[[]]", b"[{}]", b"[1, 2, 3]", b"[0.0, 0.0, 0.0]", b'["X", "X"]', b"null", b"{ a = 1 }",
    b"{ axis = 1 }", b"1979-05-27", b"07:32:00", b"'x'", b'"""', b"'''", b"#", b"//", b"\r", b"\t", b";",
    b"\xef\xbb\xbf", b"\xc2\x85", b"\xe2\x80\xa8", b"\x1c", b"\x0c", b"\xd9\xa1", b"\xff", b"\x00",
)  # fmt: skip
QUOTED = tuple(text for text in STRINGS if text[:1] in b"\"'" and text[-1:] == text[:1] and len(text) > 1)


class Mutator:
    """Changes texts. `words` are the format's own, `pool` texts from which pieces are taken."""

    def __init__(self, words: tuple[str, ...], pool: list[bytes]) -> None:
        self._words = tuple(word.encode() for word in words) or NUMBERS
        self._lines = sorted({line for text in pool for line in text.splitlines(keepends=True) if len(line) < 500})
        self._tokens = sorted({token for text in pool for token in TOKEN.findall(text) if len(token) < 100})
        self._names = [token for token in self._tokens if token.isalnum()] or [b"X"]

    def __call__(self, data: bytes, seed: int) -> bytes:
        """The text with one to four changes."""
        rng = random.Random(seed)
        for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 4))):
            data = self._of_lines(data, rng) if rng.random() < 0.35 else self._of_tokens(data, rng)
        return data

    def _of_lines(self, data: bytes, rng: random.Random) -> bytes:
        lines = data.splitlines(keepends=True) or [b""]
        at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
        match rng.randrange(7):
            case 0:
                del lines[at]
            case 1:
                lines.insert(other, lines[at])
            case 2:
                lines[at], lines[other] = lines[other], lines[at]
            case 3 if self._lines:
                lines.insert(at, rng.choice(self._lines))
            case 4 if self._lines:
                lines[at] = rng.choice(self._lines)
            case 5:
                del lines[min(at, other) : max(at, other)]
            case _:
                lines[at:at] = lines[min(at, other) : max(at, other)][:20]
        return b"".join(lines)

    def _of_tokens(self, data: bytes, rng: random.Random) -> bytes:
        tokens = TOKEN.findall(data) or [b""]
        at = rng.randrange(len(tokens))
        numbers = [i for i, token in enumerate(tokens) if token[:1].isdigit() or token[:1] in b"+-"]
        names = [i for i, token in enumerate(tokens) if token[:1] in b"\"'" or token.isalnum()]
        strings = [i for i in names if tokens[i][:1] in b"\"'"]
        match rng.randrange(11):
            case 8 | 9 if strings:
                tokens[rng.choice(strings)] = rng.choice(QUOTED + tuple(tokens[i] for i in strings))
            case 10 if strings:
                tokens[rng.choice(strings)] = b'"' + rng.choice(self._names) + b'"'
            case 0 | 1 if numbers:
                tokens[rng.choice(numbers)] = rng.choice(NUMBERS)
            case 2 if names:
                tokens[rng.choice(names)] = rng.choice(STRINGS + self._words)
            case 3 if names:
                tokens[rng.choice(names)] = tokens[rng.choice(names)]
            case 4 if numbers and names:
                one, two = rng.choice(numbers), rng.choice(names)
                tokens[one], tokens[two] = tokens[two], tokens[one]
            case 5 if self._tokens:
                tokens[at] = rng.choice(self._tokens)
            case 6:
                tokens.insert(at, rng.choice(NUMBERS + STRINGS + self._words))
            case _:
                del tokens[at]
        return b"".join(tokens)
