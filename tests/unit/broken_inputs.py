# ruff: noqa: E501 - a table of faults, one a line
"""Broken studies, models, recordings and options by kind, and the rule by which the answer to each is judged.

A kind is one fault at one place; an input is a kind with one of its values.  Every one must be refused.  The answer is

- **clear**: exit code 2, and one message that names the file (or the table and key, or the component), names what is at
  fault there (`Broken.culprits`, any of them), and says what to do (one of `REMEDIES`, as words of the message);
- **vague**: exit code 2 without one of these;
- **silent**: exit code 0;
- **fault**: exit code 1, which the program itself calls a fault of its own, or a traceback;
- **hang**: no answer within ten seconds of processor time.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

MODEL = """
from multibody import Model
from multibody.library import ForceSource, Mass, ViscousFriction

def build(mass=2.0):
    model = Model("cart")
    body = model.add("body", Mass(m=mass))
    drive = model.add("drive", ForceSource())
    guide = model.add("guide", ViscousFriction(viscous=3.0))
    model.connect(drive.flange, body.flange)
    model.connect(guide.a, body.flange)
    model.connect(guide.b, model.ground)
    model.input("force", drive.force)
    model.output("position", "body.position")
    model.output("speed", "body.velocity")
    return model
"""
STUDY = {
    "model": {"build": '"cart.py:build"', "arguments": "{ mass = 2.0 }"},
    "uncertain": {'"body.m"': "{ value = 2.0, std = 0.1, min = 0.5, max = 9.0 }"},
    "inputs": {'"force"': '{ column = "force_N", interpolation = "linear" }'},
    "outputs": {'"position"': '{ column = "position_mm", noise = 1e-4 }', '"speed"': '"speed_m_per_s"'},
    "records": {
        "time": '"time_s"',
        "identify": '["a.csv"]',
        "validate": '["b.csv"]',
        "start": "0.0",
        "stop": "9.0",
        "decimate": "1",
    },
    "candidates": {"include": '["*friction@*"]', "exclude": '["stribeck_friction@*"]'},
    "study": {"residual": '"simulation"', "seed": "1", "max_effects": "1", "level": "0.02"},
    "initial": {'"body.velocity"': "0.0", "free": '["body.position"]'},
    "offsets": {"outputs": '["speed"]'},
}
#: Words of which a message holds one where it says what to do.
REMEDIES = re.compile(
    r"\b(nearest|there are |required|did you mean|must |needs? |change |choose |give |name |write |add |use |take |leave |"
    r"set |check |repair|save |export|keep |correct|record again|copy |cut |remove|say |quote|lower |install|has to be|"
    r"higher|allow|unpack|rename|include more|sort |resample|end with|separate|assign |declare )",
    re.IGNORECASE,
)
NAMES_A_PLACE = re.compile(
    r"study\.toml|cart\.py|\b[ab]\.(csv|parquet|mat|xyz|csv\.gz)|\[\w+\]|component '|model 'cart'|--\w+|'cart' on record"
)


@dataclass(frozen=True)
class Broken:
    """One broken input.

    Parameters
    ----------
    kind : str
    variant : str
    files : dict of str to (str or bytes)
        What differs from the sound study.
    culprits : tuple of str
        Texts of which a clear message holds one.
    words : tuple of str
        Further words of the command.
    """

    kind: str
    variant: str
    files: dict[str, str | bytes]
    culprits: tuple[str, ...] = field(default=())
    words: tuple[str, ...] = field(default=())


def rows(seed: int) -> np.ndarray:
    """Return time, force, position and speed of a sound recording, shape (200, 4)."""
    time = 0.05 * np.arange(200)
    noise = np.random.default_rng(seed).standard_normal((200, 2)) * [0.05, 1e-3]
    return np.column_stack(
        [time, np.sin(time), 20.0 * np.sin(time - 1.0), 0.02 * np.cos(time - 1.0)]
    ) + np.column_stack([np.zeros((200, 2)), noise])


HEADER = "time_s,force_N,position_mm,speed_m_per_s"


def csv(values: np.ndarray, header: str = HEADER) -> str:
    """Return a recording as text."""
    return "\n".join([header, *(",".join(f"{v:.7g}" for v in row) for row in values)]) + "\n"


def toml(tables: dict[str, dict[str, str]]) -> str:
    """Return a study file."""
    return "\n".join(f"[{name}]\n" + "\n".join(f"{k} = {v}" for k, v in t.items()) for name, t in tables.items()) + "\n"


def sound() -> dict[str, str | bytes]:
    """Return the files of the sound study."""
    return {"study.toml": toml(STUDY), "cart.py": MODEL, "a.csv": csv(rows(1)), "b.csv": csv(rows(2))}


def changed(table: str, key: str, value: str | None) -> dict[str, str | bytes]:
    """Return the study file with another value of a key, or without it."""
    tables = {name: dict(content) for name, content in STUDY.items()}
    if value is None:
        tables[table].pop(key, None)
    else:
        tables[table][key] = value
    return {"study.toml": toml(tables)}


WRONG_TYPES = {
    "text": '"seven"',
    "number": "7.5",
    "list": "[1, 2]",
    "table": "{ a = 1 }",
    "true": "true",
    "date": "2026-01-01",
    "empty text": '""',
}
#: For each key those of `WRONG_TYPES` that its type allows.
FITTING = {
    "build": (), "arguments": (), '"body.m"': (), '"force"': ("text",), '"position"': ("text",), '"speed"': ("text",),
    "time": ("text",), "identify": ("text",), "validate": ("text",), "start": ("number",), "stop": ("number",),
    "decimate": (), "include": (), "exclude": (), "residual": (), "seed": (), "max_effects": (), "level": (),
    '"body.velocity"': ("number",), "free": (), "outputs": (),
}  # fmt: skip


def of_study() -> Iterator[Broken]:
    """Yield faults of the study file."""
    for table, keys in STUDY.items():
        for key in keys:
            name = key.strip('"')
            for word, value in WRONG_TYPES.items():
                if word not in FITTING[key]:
                    yield Broken(f"{table}.{name}: another type", word, changed(table, key, value), (name, table))
            misspelt = (name[:-1], name + "s", name.replace("i", "y", 1), name.upper(), "_" + name)
            for word in dict.fromkeys(w for w in misspelt if w not in (name, "min", "")):
                other = dict(STUDY[table])
                value = other.pop(key)
                other[f'"{word}"' if key[0] == '"' else word] = value
                files: dict[str, str | bytes] = {"study.toml": toml({**STUDY, table: other})}
                yield Broken(f"{table}.{name}: misspelt", word, files, (word,))
        text = toml({k: v for k, v in STUDY.items() if k != table})
        for word in (table[:-1], table + "s", table.upper(), table.replace("o", "0")):
            if word not in STUDY:
                content = "".join(f"{k} = {v}\n" for k, v in STUDY[table].items())
                yield Broken(f"[{table}] misspelt", word, {"study.toml": f"{text}[{word}]\n{content}"}, (word,))
        for value in ("3", '"a"', "[]", "true", "[[1]]"):
            yield Broken(f"[{table}] is no table", value, {"study.toml": f"{table} = {value}\n{text}"}, (table,))
        if table in ("model", "outputs", "records"):
            yield Broken(f"[{table}] is missing", "", {"study.toml": text}, (table,))
            yield Broken(f"[{table}] is empty", "", {"study.toml": f"{text}[{table}]\n"}, (table,))
    for table, key in (("records", "time"), ("records", "identify"), ("model", "build"), ("inputs", '"force"')):
        yield Broken(f"{table}.{key} is missing", "", changed(table, key, None), (key.strip('"'),))
    numbers = {
        ("records", "start"): ("nan", "inf", "1e300", "9.5"),
        ("records", "stop"): ("nan", "-1.0", "-1e300", "0.01"),
        ("records", "decimate"): ("0", "-1", "1000000", "99"),
        ("records", "low_pass_hz"): ("0.0", "-5.0", "nan", "inf", "1e9"),
        ("records", "resample"): ("0.0", "-5.0", "nan", "inf", "1e9", "0.1"),
        ("records", "longest_gap"): ("0.0", "-1.0", "nan"),
        ("records", "edge"): ("-1.0", "nan", "1e6"),
        ("study", "level"): ("0.0", "-0.1", "0.5", "1.0", "nan", "inf"),
        ("study", "seed"): ("-1", "1.5", "1e300"),
        ("study", "max_effects"): ("-1", "0.5", "nan"),
        ("initial", '"body.velocity"'): ("nan", "inf", "-inf", "1e300"),
    }
    for (table, key), values in numbers.items():
        for value in values:
            name = key.strip('"')
            yield Broken(f"{table}.{name}: a number that cannot be", value, changed(table, key, value), (name, value))
    for inner, values in {
        "std": ("0.0", "-1.0", "nan", "inf", '"a"', "true"),
        "min": ("9.5", "nan", '"a"', "99.0"),
        "max": ("0.1", "nan", "-1.0", '"a"'),
        "value": ("0.1", "10.0", "nan", "inf", '"a"', "1e300"),
        "stdev": ("1.0",),
        "bounds": ("[0, 1]",),
    }.items():
        for value in values:
            entry = {"value": "2.0", "std": "0.1", "min": "0.5", "max": "9.0", inner: value}
            text = "{ " + ", ".join(f"{k} = {v}" for k, v in entry.items()) + " }"
            yield Broken(f"uncertain: {inner}", value, changed("uncertain", '"body.m"', text), ("body.m",))
    for inner, values in {
        "noise": ("0.0", "-1.0", "nan", "inf", '"a"'),
        "unit": ('"parsec/fortnight/x"', '"N"', '"9**9**9"', "3", '"m**99"', '"kg"', '"s"'),
        "column": ('"positon_mm"', '"POSITION"', '"time_s"', '""', "3", '"force_N"', '"speed_m_per_s"'),
        "interpolation": ('"hold"', '"spline"', "1"),
        "default": ("0.0", '"a"'),
        "collumn": ('"x"',),
    }.items():
        for value in values:
            entry = {"column": '"position_mm"', inner: value}
            text = "{ " + ", ".join(f"{k} = {v}" for k, v in entry.items()) + " }"
            yield Broken(
                f"outputs: {inner}", value, changed("outputs", '"position"', text), ("position", value.strip('"'))
            )
    for key in ("include", "exclude"):
        for value in (
            "coulomb",
            "coulomb_friction@giude",
            "Coulomb_friction",
            "friction",
            "viscous_friction@",
            "@guide",
            " ",
        ):
            yield Broken(
                f"candidates.{key}: a pattern", value, changed("candidates", key, f'["{value}"]'), ("candidates",)
            )
    yield Broken("candidates: nothing left", "", changed("candidates", "exclude", '["*"]'), ("candidates",))
    for key, value in (("identify", '["b.csv"]'), ("validate", '["a.csv"]'), ("validate", '["./a.csv"]')):
        yield Broken("records: held out and fitted", key + value, changed("records", key, value), ("a.csv", "b.csv"))
    for value in (
        '["c.csv"]',
        '["*.mat"]',
        '["../a.csv"]',
        '["$NOWHERE/a.csv"]',
        '["."]',
        "[]",
        '["a.csvv"]',
        '["folder"]',
    ):
        yield Broken(
            "records.identify: no such file", value, changed("records", "identify", value), ("identify", "records")
        )
    for value in (
        "os:system", "/etc/passwd:x", "cart.py", "cart.py:", ":build", "cart.py:builld", "card.py:build",
        "../cart.py:build", "json:loads", "vtsdt.lft:reference", "cart.py:build()", "cart.py:Model.x", "cart py:build",
    ):  # fmt: skip
        yield Broken("model.build: cannot be", value, changed("model", "build", f'"{value}"'), ("build",))
    for value in (
        "{ mas = 2.0 }",
        "{ mass = -1.0 }",
        '{ mass = "a" }',
        "{ mass = nan }",
        "{ mass = [] }",
        "{ mass = -0.5 }",
    ):
        yield Broken("model.arguments: cannot be", value, changed("model", "arguments", value), ("mas", "body"))
    text = toml(STUDY)
    for word, broken in {
        "no closing bracket": text.replace("[records]", "[records"),
        "no quotes": text.replace('"time_s"', "time_s"),
        "twice the same key": text.replace("seed = 1", "seed = 1\nseed = 2"),
        "twice the same table": text + "[study]\nseed = 1\n",
        "one parameter quoted and bare": text.replace("[uncertain]\n", "[uncertain]\nbody.m = { std = 1.0 }\n"),
        "True in capitals": text.replace("decimate = 1", "drop_nan = True"),
        "JSON": '{"model": {"build": "cart.py:build"}}',
        "YAML": "model:\n  build: cart.py:build\n",
        "empty": "",
        "blanks": " \n\n",
        "a null byte": text + "\0",
        "a lone bracket": "[",
        "a page": "<html></html>",
    }.items():
        yield Broken(f"study.toml: {word}", "", {"study.toml": broken}, ("study.toml",))
    for word, raw in {
        "UTF-16": text.encode("utf-16"),
        "Latin-1": text.replace("time_s", "Zeit_ü").encode("latin-1"),
        "noise": np.random.default_rng(0).bytes(500),
    }.items():
        yield Broken(f"study.toml: {word}", "", {"study.toml": raw}, ("study.toml",))


def of_recordings() -> Iterator[Broken]:
    """Yield faults of recordings."""
    whole = changed("records", "stop", None)
    for broken in _recordings():
        yield replace(broken, files={**whole, **broken.files})


def _recordings() -> Iterator[Broken]:
    good = rows(1)
    lines = csv(good).splitlines()
    columns = HEADER.split(",")
    for place in (1, 2, 100, 199, 200):
        for k, name in enumerate(columns):
            for word in ("nan", "inf", "-inf", "", "abc", "1,5", "1.2.3", "--", "0x1F", "1e999", "12:30:00"):
                cells = lines[place].split(",")
                cells[k] = word
                text = "\n".join([*lines[:place], ",".join(cells), *lines[place + 1 :]]) + "\n"
                yield Broken(f"a.csv: '{word}' in {name}", f"line {place + 1}", {"a.csv": text}, (name, "line"))
        for word, line in {"a cell too few": ",".join(lines[place].split(",")[:-1]), "a word": "end of data"}.items():
            text = "\n".join([*lines[:place], line, *lines[place + 1 :]]) + "\n"
            yield Broken(f"a.csv: {word}", f"line {place + 1}", {"a.csv": text}, ("line",))
        if 1 < place < 200:
            for word, step in {"time stands": 0.0, "time runs back": -3.0}.items():
                wrong = good.copy()
                wrong[place, 0] = wrong[place - 1, 0] + step
                yield Broken(f"a.csv: {word}", f"row {place}", {"a.csv": csv(wrong)}, ("time_s",))
            gap = good.copy()
            gap[place:, 0] += 20.0
            yield Broken(
                "a.csv: a gap", f"row {place}", {"a.csv": csv(gap), **changed("records", "stop", None)}, ("time_s",)
            )
    for count in range(8):
        yield Broken("a.csv: too few rows", str(count), {"a.csv": csv(good[:count])}, ("a.csv",))
    for k, name in enumerate(columns):
        for word in (name[:-1], name.upper(), name.replace("_", " "), "x"):
            names = [*columns[:k], word, *columns[k + 1 :]]
            yield Broken(f"a.csv: column {name} misnamed", word, {"a.csv": csv(good, ",".join(names))}, (name,))
        twice = [*columns[:k], columns[k - 1], *columns[k + 1 :]]
        yield Broken("a.csv: a column twice", name, {"a.csv": csv(good, ",".join(twice))}, tuple(columns))
        flat = good.copy()
        flat[:, k] = 1.0
        if k in (0, 2, 3):
            both: dict[str, str | bytes] = {"a.csv": csv(flat), "b.csv": csv(flat)} if k else {"a.csv": csv(flat)}
            yield Broken("a.csv: a constant column", name, both, (name, "a.csv"))
    random = np.random.default_rng(5)
    jumpy = good.copy()
    jumpy[:, 0] = np.sort(random.uniform(0.0, 10.0, 200))
    yield Broken("a.csv: uneven time", "", {"a.csv": csv(jumpy)}, ("time_s",))
    text = csv(good)
    for word, raw in {
        "no header": "\n".join(lines[1:]),
        "a header alone": lines[0],
        "empty": "",
        "blank lines": "\n\n\n",
        "a page": "<html><body>not found</body></html>",
        "JSON": '{"time_s": [0, 1]}',
        "thousands separators": text.replace("time_s", "time_s").replace("0.05,", '"1,000.05",', 1),
    }.items():
        yield Broken(f"a.csv: {word}", "", {"a.csv": raw}, ("a.csv",))
    raw = text.encode()
    for size in (0, 1, 10, 100, 1000, 4000):
        yield Broken("a.csv: binary", str(size), {"a.csv": b"\x00\x01" + random.bytes(size)}, ("a.csv",))
    import gzip

    packed = gzip.compress(raw)
    for size in (2, 5, 15, 100, 1000, len(packed) - 5):
        files: dict[str, str | bytes] = {"a.csv.gz": packed[:size], **changed("records", "identify", '["a.csv.gz"]')}
        yield Broken("a.csv.gz: cut off", str(size), files, ("a.csv.gz",))
    for place in range(12, len(packed), len(packed) // 12):
        damaged = bytearray(packed)
        damaged[place] ^= 0xFF
        files = {"a.csv.gz": bytes(damaged), **changed("records", "identify", '["a.csv.gz"]')}
        yield Broken("a.csv.gz: damaged", str(place), files, ("a.csv.gz",))
    for ending in ("parquet", "mat", "xyz", "csv.gz"):
        for word, content in {
            "text": raw,
            "nothing": b"",
            "noise": random.bytes(3000),
            "PAR1": b"PAR1" + raw + b"PAR1",
        }.items():
            name = f"a.{ending}"
            files = {name: content, **changed("records", "identify", f'["{name}"]')}
            yield Broken(f"{name}: not such a file", word, files, (name,))


def of_models() -> Iterator[Broken]:
    """Yield faults of the model's file."""
    body = "    return model\n"
    for name in (
        "ValueError", "KeyError", "TypeError", "ZeroDivisionError", "RuntimeError", "MemoryError", "RecursionError", "OSError",
        "AssertionError", "AttributeError", "ImportError", "SystemExit", "StopIteration", "NotImplementedError",
    ):  # fmt: skip
        yield Broken("cart.py raises", name, {"cart.py": MODEL.replace(body, f"    raise {name}('x')\n")}, (name,))
        yield Broken("cart.py raises when imported", name, {"cart.py": f"raise {name}('x')\n" + MODEL}, (name,))
    for value in ("None", "3", "'cart'", "[model]", "Model", "model.build()", "body", "{}", "(model, 1)"):
        yield Broken(
            "cart.py returns no model",
            value,
            {"cart.py": MODEL.replace("return model", f"return {value}")},
            ("return",),
        )
    for word, (old, new) in {
        "syntax": ("def build", "def def build"),
        "indent": ("    body =", "  body ="),
        "a name": ("drive.flange, body", "drive.flangee, body"),
        "a port": ("guide.a", "guide.c"),
        "an import": ("import Model", "import Modle"),
        "a part": ("import ForceSource", "import ForceSorce"),
        "a parameter": ("viscous=3.0", "viscos=3.0"),
        "a parameter of text": ("viscous=3.0", "viscous='a'"),
        "a parameter NaN": ("viscous=3.0", "viscous=float('nan')"),
        "a parameter infinite": ("viscous=3.0", "viscous=float('inf')"),
        "a part twice": ('model.add("guide"', 'model.add("body"'),
        "an input of nothing": ("drive.force", "'drive.forse'"),
        "an output of nothing": ('"body.position"', '"body.positon"'),
        "another input": ('model.input("force"', 'model.input("push"'),
        "another output": ('model.output("speed"', 'model.output("sped"'),
        "a required argument": ("mass=2.0", "mass, more"),
        "nothing defined": (MODEL, ""),
        "null bytes": (MODEL, "\0" + MODEL),
    }.items():
        yield Broken(
            f"cart.py: {word}", "", {"cart.py": MODEL.replace(old, new)}, ("cart", "build", "the model has no")
        )
    for word, raw in {"UTF-16": MODEL.encode("utf-16"), "noise": np.random.default_rng(1).bytes(300)}.items():
        yield Broken(f"cart.py: {word}", "", {"cart.py": raw}, ("cart.py",))


def of_rarer_keys() -> Iterator[Broken]:
    """Yield faults of keys that the sound study does not need."""
    optional = {
        "low_pass_hz": ("number",), "edge": ("number",), "resample": ("number",), "trip": ("text",), "drop_nan": ("true",),
        "drop_duplicates": ("true",), "gaps": (), "longest_gap": ("number",), "time_unit": (), "time_format": (),
        "time_zone": (), "skip_rows": (), "uneven": (),
    }  # fmt: skip
    for key, fitting in optional.items():
        for word, value in WRONG_TYPES.items():
            if word not in fitting:
                yield Broken(f"records.{key}: another type", word, changed("records", key, value), (key,))
    for key, values in {
        "time_unit": ('"parsec"', '"9**9**9"', '"m"', '"N"', '"s s s"'),
        "time_zone": ('"Europe/Nowhere"', '"+99:00"', '"CETT"'),
        "time_format": ('"%"', '"%Q"'),
        "skip_rows": ("-1", "199", "1000000", "1.5"),
        "trip": ('"trip_no"', '"force"', '"a.csv"'),
        "gaps": ('"splitt"', '"join"'),
        "uneven": ('"own instant"', '"allow"'),
    }.items():
        for value in values:
            files = changed("records", key, value)
            yield Broken(f"records.{key}: cannot be", value, files, (key, value.strip('"')))
    for key, values in {
        "search": ('"evidences"', '"fast"', "1"),
        "most_rows": ("0", "-1", "100", "1.5", '"all"'),
        "time_limit": ("0", "-1.0", "nan", '"60 s"'),
        "inputs": ('"recorded"', "true"),
        "residual": ('"simulations"', '"backward"'),
    }.items():
        for value in values:
            yield Broken(f"study.{key}: cannot be", value, changed("study", key, value), (key, value.strip('"')))
    for value in (
        '"2.3 - body.positoin"', '"2.3 -"', '"position("', '"2 ** position"', '"os.system"', '"measurd"', '"equilibrum"',
        '"position / 0"', "[1.0]", "true", "{ record = {} }", '{ record = { "x*" = 1.0 } }', "{ records = 1.0 }",
        '{ record = { "*" = "nowhere" } }', '"1e999"', '"((((position"',
    ):  # fmt: skip
        files = changed("initial", '"body.position"', value)
        files["study.toml"] = str(files["study.toml"]).replace('free = ["body.position"]', "")
        yield Broken("initial: a start that cannot be", value, files, ("body.position",))
    for value in ('["body.positn"]', '["speed"]', '["guide.viscous"]', '["body.velocity", "body.velocity"]'):
        yield Broken("initial.free: cannot be", value, changed("initial", "free", value), ("free", "body.velocity"))
    for value in ('["sped"]', '["force"]', '["body.velocity"]', '["speed", "speed"]'):
        yield Broken("offsets.outputs: cannot be", value, changed("offsets", "outputs", value), ("outputs",))
    text = toml(STUDY)
    for entry in (
        '"c*.csv" = { offset = 0.5 }', '"a.csv" = { offset = nan }', '"a.csv" = { offset = "a" }', '"a.csv" = { ofset = 1.0 }',
        '"a.csv" = 0.5', '"*" = { fit = 1 }', '"*" = { fit = true }', '"" = { offset = 1.0 }',
    ):  # fmt: skip
        yield Broken("clocks: cannot be", entry, {"study.toml": f"{text}[clocks]\n{entry}\n"}, ("clocks",))
    for entry in ('"guide" = { force = "F", motion = "s", rate = "v" }', '"guide" = { force = "F" }', "x = 1"):
        yield Broken(
            "connections: cannot be", entry, {"study.toml": f"{text}[connections]\n{entry}\n"}, ("connections",)
        )
    for key in (
        "guide.viscos",
        "guid.viscous",
        "body",
        "body.velocity",
        "viscous",
        "guide.viscous.x",
        "drive.force",
        "Body.m",
    ):
        entry = f'"{key}" = {{ std = 0.1 }}\n'
        yield Broken(
            "uncertain: no parameter",
            key,
            {"study.toml": text.replace("[uncertain]\n", f"[uncertain]\n{entry}")},
            (key,),
        )
    for key in ("forc", "drive.force", "position", "body", "speed"):
        yield Broken("inputs: no input", key, {"study.toml": text.replace('"force" =', f'"{key}" =')}, (key, "force"))
    for key in ("positon", "force", "body.m", "body", "body.positionn"):
        yield Broken("outputs: no output", key, {"study.toml": text.replace('"position" =', f'"{key}" =')}, (key,))
    for name in ("a.fmu", "nowhere.fmu", "cart.py"):
        for word, raw in {"noise": np.random.default_rng(3).bytes(400), "text": b"a unit", "nothing": b""}.items():
            tables = {**STUDY, "model": {"fmu": f'"{name}"'}}
            files = {"study.toml": toml(tables), "a.fmu": raw}
            yield Broken("model.fmu: no unit", f"{name}, {word}", files, (name, "fmu"))


def of_options() -> Iterator[Broken]:
    """Yield faults of options of the command."""
    for option, values in {
        "--memory": ("0", "-1", "nan", "inf", "a", "1e-9", ""),
        "--time-limit": ("0", "-1", "nan", "a", ""),
        "--out": ("study.toml/out", "study.toml", "a.csv"),
    }.items():
        for value in values:
            yield Broken(f"{option}: cannot be", value, {}, (option, value or option), (option, value))
    for option in ("--memry", "--ouut", "--level", "--seeed"):
        yield Broken("an option that is not there", option, {}, (option,), (option, "1"))
    yield Broken("a word too many", "", {}, ("b.toml",), ("b.toml",))


PART = """
import math
from multibody import Component, Model, Output, Parameter, Power, State, Table, Translation
from multibody.library import ForceSource, Mass

def twice(x):
    return 2.0 * x

class Guide(Component):
    "Friction of the guide."
    c = Parameter(3.0, "N*s/m", "friction", min=0.0)
    flange = Translation("the body")
    warming = State("K", "above the start")
    shown = Output("N", "friction")
    power = Power(kind="loss")

    def equations(self):
        v = self.flange.velocity
        f = self.c * v
        self.shown = f
        self.flange.force = -f
        self.power = f * v
        self.der.warming = f * v / 500.0

def build(mass=2.0):
    model = Model("cart")
    body = model.add("body", Mass(m=mass))
    drive = model.add("drive", ForceSource())
    guide = model.add("guide", Guide())
    model.connect(drive.flange, body.flange, guide.flange)
    model.input("force", drive.force)
    model.output("position", "body.position")
    model.output("speed", "body.velocity")
    return model
"""


def of_equations() -> Iterator[Broken]:
    """Yield faults of a component that the study's author wrote."""
    law = "        f = self.c * v\n"
    for word in (
        "1.0 / (v - v)", "0.0 * v / (0.0 * v)", "math.sqrt(-1.0 - v**2)", "math.log(-abs(v))", "math.log(v - v)",
        "math.exp(1e4 + v)", "1e300 * 1e300 * v", "v * float('nan')", "math.acos(2.0 + v**2)", "(-1.0 - v**2) ** 0.5",
        "math.sqrt(v - 1.0)", "1.0 / self.warming", "-1e6 * v", "-1e12 * v", "math.tan(math.pi / 2.0) * 1e300 * v",
    ):  # fmt: skip
        yield Broken(
            "an equation without a value",
            word,
            {"cart.py": PART.replace(law, f"        f = {word}\n")},
            ("guide", "Guide"),
        )
    for word in (
        "self.d * v", "self.c * u", "self.flange.speed", "self.flang.velocity", "self.der.heat", "twise(v)", "twice(v, v)",
        "math.erfinv(v)", "max(v)", "[v][0]", "'v'", "v @ v", "lambda: v", "print(v)", "np.sin(v)", "v if v else", "v.real",
        "{1: v}[1]", "sum([v])", "f + v", "self", "None", "v := 1.0", "open('a.csv')", "__import__('os')", "self.c.real",
        "await v", "math.sin", "math.sin()", "1j * v", "self.equations()", "twice", "v << 2", "v[0]", "*v", "...",
    ):  # fmt: skip
        yield Broken(
            "an equation that cannot be read",
            word,
            {"cart.py": PART.replace(law, f"        f = {word}\n")},
            ("guide", "Guide", "cart.py"),
        )
    for word in (
        "while v > 0.0:\n            v = v - 1.0", "for k in v:\n            f = k", "import os", "return v", "del v", "global v",
        "try:\n            f = v\n        except ValueError:\n            f = v", "with v:\n            f = v", "raise ValueError",
        "def g():\n            return v", "class G:\n            pass", "assert v > 0.0", "if v > 0.0:\n            f = v",
        "f: str = v", "f, g = v", "self.c = v", "self.flange.velocity = v", "yield v", "pass",
        "for k in range(10**9):\n            f = v + k", "self.time = v", "self.new = v",
    ):  # fmt: skip
        yield Broken(
            "a statement that equations cannot have",
            word.splitlines()[0],
            {"cart.py": PART.replace(law, f"        {word}\n")},
            ("guide", "Guide", "cart.py"),
        )
    for missing in ("self.shown = f", "self.der.warming = f * v / 500.0", "self.power = f * v"):
        yield Broken(
            "a quantity without an equation",
            missing,
            {"cart.py": PART.replace(f"        {missing}\n", "")},
            ("guide", "Guide"),
        )
    for word, (old, new) in {
        "unit": ('"N*s/m"', '"N*s/mm"'), "unknown unit": ('"N*s/m"', '"N*s/meterr"'), "huge unit": ('"N*s/m"', '"9**9**9"'),
        "default": ("Parameter(3.0", "Parameter('3'"), "default below": ("Parameter(3.0", "Parameter(-3.0"),
        "default NaN": ("Parameter(3.0", "Parameter(float('nan')"), "no default": ("Parameter(3.0", "Parameter(None"),
        "bounds": ("min=0.0", "min=9.0, max=1.0"), "bound of text": ("min=0.0", "min='0'"), "option": ("min=0.0", "least=0.0"),
        "kind": ('kind="loss"', 'kind="heat"'), "no unit": ('Output("N", "friction")', "Output()"),
        "reserved": ("    warming = State", "    time = State"), "start": ('State("K", "above the start")', 'State("K", "above", start="a")'),
        "start NaN": ('State("K", "above the start")', 'State("K", "above", start=float("nan"))'), "no class": ("(Component)", "(object)"),
        "no equations": ("def equations(self)", "def equation(self)"), "arguments": ("def equations(self)", "def equations(self, t)"),
        "not called": ("Guide())", "Guide)"), "a value too many": ("Guide())", "Guide(d=3.0))"), "a value of text": ("Guide())", 'Guide(c="fast"))'),
        "another unit": ("Guide())", 'Guide(c="3 kg"))'), "below its bound": ("Guide())", "Guide(c=-3.0))"),
        "two domains": ("guide.flange)", "guide.flange, guide.shown)"), "no flange": ("guide.flange)", "guide.flnge)"),
        "init": ('    "Friction of the guide."', "    def __init__(self):\n        pass"),
        "a name with a blank": ('"guide", Guide', '"guide a", Guide'), "an empty name": ('"guide", Guide', '"", Guide'), "a number as name": ('"guide", Guide', "3, Guide"),
    }.items():  # fmt: skip
        yield Broken(
            f"a component of one's own: {word}", "", {"cart.py": PART.replace(old, new)}, ("guide", "Guide", "cart")
        )


def corpus() -> list[Broken]:
    """Return every broken input."""
    return [*of_study(), *of_recordings(), *of_models(), *of_rarer_keys(), *of_options(), *of_equations()]


def write(broken: Broken, folder: Path) -> Path:
    """Write a broken input into a folder; return the study file."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in {**sound(), **broken.files}.items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder / "study.toml"


def judged(broken: Broken, code: int, message: str) -> str:
    """Return what an answer is by the rule above."""
    if code == 0:
        return "silent"
    if code != 2 or "Traceback" in message or "a fault in the program" in message:
        return "fault"
    named = bool(NAMES_A_PLACE.search(message)) and any(culprit in message for culprit in broken.culprits)
    return "clear" if named and REMEDIES.search(message) and len(message) < 20_000 else "vague"
