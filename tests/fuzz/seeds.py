"""What fuzzing begins with, beside the kept corpus: files of `designs` and of the tests, and small ones of every form."""

from collections.abc import Iterator
from pathlib import Path

from symfive.machine import machine_to_data, read_machine
from symfive.toml_files import toml_text

from .bundle import packed

ROOT = Path(__file__).resolve().parents[2]
PLANS, DATA = ROOT / "designs" / "plans", ROOT / "tests" / "data"
MACHINES = sorted((ROOT / "designs" / "machines").glob("*.toml"))


def nothing() -> Iterator[bytes]:
    """No seeds beside the kept corpus."""
    return iter(())


def machines() -> Iterator[bytes]:
    """The ready-made machines, and one of them as symfive writes it itself."""
    yield from (path.read_bytes() for path in MACHINES)
    yield toml_text(machine_to_data(read_machine(MACHINES[0])), sections=("axes",)).encode()


def campaigns() -> Iterator[bytes]:
    """Plans of `designs` and campaigns of the tests, of every CSV the first rows."""
    for file in sorted(PLANS.glob("*/campaign.toml")):
        names = sorted(path.name for path in file.parent.glob("*.csv"))
        if len(names) <= 6:
            yield packed(file.parent, "campaign.toml", "machine.toml", *names)
    for file in sorted((DATA / "campaigns").glob("*/fit/campaign.toml")):
        yield packed(file.parent, "campaign.toml", "machine.toml", *sorted(p.name for p in file.parent.glob("*.csv")))


def recordings() -> Iterator[bytes]:
    """Recordings in motion with and without readings, whole and with lost rows."""
    yield b"t_s,Y_mm,X_mm,Z_mm,dL_um\n0.0,1.5,2,3,-0.1\n0.1,1,2,3,1e-3\n0.2,1,2,3,0.2\n"
    yield b"t_s,Y_mm,X_mm,Z_mm\n" + b"".join(b"%d,0,%d,0\n" % (i, i) for i in range(30))
    yield b"X_mm , t_s,Z_mm,Y_mm\r\n" + b"".join(b" %g , %g,1,0\r\n" % (i, 0.01 * i) for i in range(12)) + b"\n\n"
    yield b"\xef\xbb\xbfdL_um,X_mm,t_s,Z_mm,Y_mm\r" + b"".join(
        b"%d,0,%g,0,0\r" % (i, i + 5 * (i > 4)) for i in range(9)
    )


def circles() -> Iterator[bytes]:
    """Both senses, all separators, with and without a head."""
    angles = range(0, 360, 15)
    yield b"angle deviation\n" + b"".join(b"%d %g\n" % (a, 1e-3 * a) for a in angles)
    yield b"".join(b"%d;0,%03d\r\n" % (-a, a) for a in angles)
    yield b"# head, 1\n\n" + b"".join(b"%d.5,\t0.001\n" % ((350 - a) % 360) for a in angles)
    yield b"1;2;3\n" + b"".join(b" %d\t-1e-3 \n" % ((a + 90) % 360) for a in angles)


def declared() -> Iterator[bytes]:
    """Rows of three numbers, and of another count."""
    angles = range(0, 360, 15)
    yield b"number,deviation,angle\n" + b"".join(b"%d,%g,%d\n" % (i, 0.1 * i, a) for i, a in enumerate(angles))
    yield b"".join(b"%d;%d,5;%d,0\r\n" % (i, i % 5, 350 - a) for i, a in enumerate(angles))
    yield b"".join(b"%d %d %d 4\n" % (i, i, i) for i in angles)
    yield b"".join(b"%d\n" % i for i in angles)


def probes() -> Iterator[bytes]:
    """The probes of the tests."""
    return (path.read_bytes() for path in sorted((DATA / "mtconnect").glob("*.xml")))


LOG = "".join(
    f"T:X-PosAct 2022-04-06 12:48:{t:02d}.5 {t // 9}\nT:Rotation-PosAct 2022-04-06 12:48:{t:02d}.5 {3 * t}\n"
    f"T:ec0-EL7201-PosAct 2022-04-06 12:48:{t:02d}.3 {99 * t}\nI:ILD_DownSample 2022-04-06 12:48:{t:02d}.2 {t}\n"
    f"T:E-Enc-PosAct 2022-04-06 12:48:{t:02d}.9 {t} LOLO\nT:X-PosCmd 2022-04-06 12:48:{t:02d} {t // 9}\n"
    + "".join(f"T:-AI0{k} 2022-04-06 12:48:{t:02d}.4 {k * t}\n" for k in range(1, 5))
    + (f"I:TestNumber 2022-04-06 12:48:{t:02d}.1 {1000 + t}\n" if t % 7 == 0 else "")
    for t in range(0, 40, 2)
)  # fmt: skip
DAT = "TEST_DATA=TGT_SET_PV=T:X-PosCmd\n" + "".join(
    f"TEST_DATA=TGT_DATA[{i}]={10 * i}\nTEST_DATA=REF_DATA_FWD[{i},1]={10 * i}.01\nTEST_DATA=REF_DATA_BWD[{i},1]={10 * i}.02\n"
    for i in range(1, 5)
)
JOINTS = "".join(",".join(f"{0.1 * ((i * k) % 7):g}" for k in range(1, 8)) + "\n" for i in range(1, 6))


def recorded() -> Iterator[bytes]:
    """Small recordings in the forms of the public ones."""
    for name in ("jjxray-slit", "ess-xyz", "ess-rotary/wobbling", "ess-rotary/radial-load"):
        yield f"=== {name}/a.log\n{LOG}".encode()
    for name in ("ecmc-iso230", "ess-xyz"):
        report = "=== {}/a.md\nTarget position source | T:X-PosCmd |\nTarget Position | Reference | 1.01 |\n"
        yield f"=== {name}/a_ISO230.dat\n{DAT}{report.format(name)}".encode()
    yield f"=== mukca/panda_1/a/hole_1.csv\n{JOINTS}".encode()
    six = "".join(" ".join(line.split(",")[:6]) + "\n" for line in JOINTS.splitlines())
    three = "".join(f"{1000 + 10 * i} {20 * (i % 3)} {7 * i * i}\n" for i in range(5))
    names = ("generated_joints", "measured_joints", "measured_SMR_1", "measured_base_1")
    texts = (six, six, three, "1000 20 7\n" * 5)
    yield "".join(f"=== irb120-tracker/{n}.txt\n{text}" for n, text in zip(names, texts, strict=True)).encode()
