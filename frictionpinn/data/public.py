"""Public recordings of mechanisms with friction, fetched from their homes and checked."""

from __future__ import annotations

import gzip
import hashlib
import json
import os
import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from frictionpinn.errors import UserError, choose

FOLDER_VARIABLE = "FRICTIONPINN_DATA"

BRFD_COLUMNS = ("time_s", "displacement_in", "force_kip", "velocity_in_per_s", "actuator1_lb", "actuator2_lb")


@dataclass(frozen=True)
class RemoteFile:
    """A file of a public set.

    Attributes:
        url: where it is fetched from.
        stored: file name in the cache folder.
        sha256: of the bytes, or of the rows where ``rows`` is set.
        rows: the checksum is that of the rows of numbers, which JSON and CSV share, written with "%.7g".
    """

    url: str
    stored: str
    sha256: str
    rows: bool = False


@dataclass(frozen=True)
class Dataset:
    """A public set: its files by short name, their folder, where it comes from and under which licence."""

    folder: str
    source: str
    licence: str
    files: dict[str, RemoteFile]


_GITHUB = "https://raw.githubusercontent.com"
_EMPS = (
    f"{_GITHUB}/forgi86/sysid-neural-continuous/93afc131780fb1d5477472935a18ac8405683890/examples/EMPS/data/DATA_EMPS"
)
_PENDULUM = f"{_GITHUB}/dynamicslab/MultiArm-Pendulum"
_PENDULUM_FIT = f"{_PENDULUM}/78ed9353702f1f9e92c74d3bb671a7804fb41fb0/ParameterEstimation/SinglePendulum"
_UR10E = f"{_GITHUB}/shamilmamedov/dynamic_calibration"
_UR10E_FILES = {
    "50sec": (
        "3afa267a6dca8a91a6938e878a32ca086c5cc606/data_ur10/ur-20_02_12-50sec_12harm.csv",
        "bb48cca42716a88f8b255d2d1b3eb3fa4a6eac4a9a52b694d4c1066ce8b4ca51",
    ),
    "30sec": (
        "ded626374e0aafe008758e8f5d1b4570c196c759/data_ur10/identification_data/ur-20_02_10-30sec_12harm.csv",
        "341fff80f177be564c8720ea898165addfd46d7cbe6f3ffd8923eeaae0eef000",
    ),
    "40sec": (
        "3afa267a6dca8a91a6938e878a32ca086c5cc606/data_ur10/ur-20_02_12-40sec_12harm.csv",
        "1355f739afecc5a9330f906e0c403be0080407f5ce2c26652556fac5748c6236",
    ),
    "ptp": (
        "75b04d420373b7ae5ff27b0179e8a009665ec2af/dataset_ur10e/validation_data/ur-20_01_17-ptp_10_points.csv",
        "d97a4ac0c8b892b565d12f33af2bf0ef18183f7742e49d847d8ba92a041b56d8",
    ),
    "unloaded": (
        "ded626374e0aafe008758e8f5d1b4570c196c759/data_ur10/identification_data/ur-20_02_19_14harm50sec.csv",
        "cd503afc985c41a6ad8fbe47d443c961eadbde4822a87ff3e17adcb2a24fa103",
    ),
    "loaded": (
        "3afa267a6dca8a91a6938e878a32ca086c5cc606/data_ur10/ur-20_02_19_14harm50secLoad.csv",
        "e689a99e5ff00ac38d03a2b9302e77688de0db8388b1d9c0e6aad3f77962758c",
    ),
    "urdf": (
        "b382f14bc40c84e1e0114121b3a697504d7aa6a0/URe/urdf/ur10e.urdf",
        "0d2abc6ebc70725c691a35aa6c2d03fd6e8158017a1b7da7a10a3ef52de7b821",
    ),
}
_BRFD = f"{_GITHUB}/ARTS-Laboratory/Dataset-Friction-Damper-with-Backlash/0e09aa9d950760277e31c08cd93fd01f39a5af09/data"
_BRFD_FOLDERS = {2: "dataset-2/characterization%20datasets", 3: "dataset-3/characterization%20tests"}
BRFD_TENSION_LB = {2: 36, 3: 30}

_BRFD_ROWS = {
    (2, "0.25Hz 0.5in"): "d5c2387d00aef1e59edbeebd8943d2b0f96275ec3fe58ab27fe43e9d2f5d5651",
    (2, "0.25Hz 1.5in"): "6a1052c98f629c3e8546c7f2e2d5151f0c6a73005d6cec400b342bd4bf034c70",
    (2, "0.25Hz 1in"): "d137a6aac5e714d7476a9ddda238aab0ba28ed164c3c9b49580e5c6202414fc1",
    (2, "0.5Hz 0.5in"): "0634c2d93d064e865a543aa0fa6a3f9dc9f05e4b0a010166fb43975616529514",
    (2, "0.5Hz 1.5in"): "0ee07c8af44caf5ebaff2091c290ef8da05b1dec82b960413525b0f060471a00",
    (2, "0.5Hz 1in"): "8d1138db017adcc574ded9707bd7c1d0801c8737ece8a8ba8e60007a6809b146",
    (2, "1Hz 0.5in"): "7f2495ec5d8cbf8dbf838818d1764d64528a153a4b0ffc123ef368214f18d095",
    (2, "1Hz 1.5in"): "7101dfe5676846eb69af716d464b6565ed87e3d5e72860f44f2c732a6fb5388f",
    (2, "1Hz 1in"): "107c959b9c537353027d7ccd70c105e255049f06e03670173156acef1f460ecf",
    (2, "2Hz 0.5in"): "b73f6f081a61c4e71c91777942e58fe84b0ec802f770c9ff4b525a6f0417cf6f",
    (3, "0.25Hz 0.5in"): "ff40194ab75ab297b065be7e9c38f62bb61ac80aad56b82f76d3a6de43c896f4",
    (3, "0.25Hz 1.5in"): "fb8b901aa68d38cd8480752084e7111c1d80821eac620ad9d0d184ca15a1340b",
    (3, "0.25Hz 1in"): "e6abeffb3351c23fa7291783428a1cc0b2bf10758caf94b0fc9219acaa79cb56",
    (3, "0.5Hz 0.5in"): "bcf1bf1eb94ca59b0cbbd4bf4ca306e48710ddf7d568422aeedecb357024fb25",
    (3, "0.5Hz 1.5in"): "60b0a9ede39265a81d6d785e30dcea79d4dd3ffd3fb3f7a8e35e2caeef7eb69f",
    (3, "0.5Hz 1in"): "b23d2791310df4aca2c1c13b1ec90edc75a44cc160e33292c464cb801be3065e",
    (3, "1Hz 0.5in"): "db893ab44db36692c18ed33bf13e99b014a69aef3e0c8f68d062b1f950f93056",
    (3, "1Hz 1.5in"): "3ccfdef252d143320717a95b720f3c1e6552ae876c64ae48ce75240ae1837d2e",
    (3, "1Hz 1in"): "d0a8a1a63ed2376f74f10ab46f1fc826a57bd592e010cfc976cfbbd7b5949aa5",
    (3, "2Hz 0.5in"): "1eec116bf7cfae7bcf1c627dcbd0a8b5de8632466afd12e484315148d525835f",
}


def _brfd_files() -> dict[str, RemoteFile]:
    files = {}
    for (number, run), sha256 in _BRFD_ROWS.items():
        tension = BRFD_TENSION_LB[number]
        frequency, amplitude = run.split()
        name = f"dataset{number}_{frequency}_{tension}lb_{amplitude}"
        remote = f"{frequency}{tension}lbtension{amplitude.removesuffix('in')}amplitude.json"
        files[name] = RemoteFile(f"{_BRFD}/{_BRFD_FOLDERS[number]}/{remote}", f"{name}.json", sha256, rows=True)
    return files


DATASETS = {
    "emps": Dataset(
        folder="emps",
        source="Janot, Gautier and Brunot (2019), nonlinear benchmark EMPS; copy in forgi86/sysid-neural-continuous",
        licence="Apache-2.0 (the repository; the data carry no statement of their own)",
        files={
            "fit": RemoteFile(
                f"{_EMPS}.mat", "DATA_EMPS.mat", "6cf6814ae14618795da0101aae2bb97ff0c6351b0501b5492751b02b07facf7e"
            ),
            "pulses": RemoteFile(
                f"{_EMPS}_PULSES.mat",
                "DATA_EMPS_PULSES.mat",
                "0eab75bb1f6b16228ee78791343a88bf9bfd9a51036ac9807d7b5fc11c0e1704",
            ),
        },
    ),
    "multiarm_pendulum": Dataset(
        folder="multiarm_pendulum",
        source="github.com/dynamicslab/MultiArm-Pendulum",
        licence="MIT",
        files={
            "estimation": RemoteFile(
                f"{_PENDULUM_FIT}/SinglePendulumDataForParameterEstimation.mat",
                "SinglePendulumDataForParameterEstimation.mat",
                "f3b8cdda4a6e86405ec37ff32b98be76fd37806a609cba7870628c1e40377a98",
            ),
            "parameters": RemoteFile(
                f"{_PENDULUM_FIT}/EstimatedParameters_SinglePendulum.mat",
                "EstimatedParameters_SinglePendulum.mat",
                "64108f0f69a202f8893a376bd87b69cd54ed13664aed33db085766639a5b0962",
            ),
            "raw": RemoteFile(
                f"{_PENDULUM}/e99a7e13/Datas/SinglePendulum/SingleDataFreeSwing_1_Dt_0_0001.mat",
                "SingleDataFreeSwing_1_Dt_0_0001.mat",
                "5e6272350a91fb9fb99b6949bc49e3e63e21af977cc1f777310f5d8e9b0fc7e7",
            ),
        },
    ),
    "brfd": Dataset(
        folder="brfd",
        source="github.com/ARTS-Laboratory/Dataset-Friction-Damper-with-Backlash",
        licence="CC BY-SA 4.0",
        files=_brfd_files(),
    ),
    "ur10e": Dataset(
        folder="ur10e",
        source="github.com/shamilmamedov/dynamic_calibration",
        licence="none stated: fetched, never shipped",
        files={
            name: RemoteFile(f"{_UR10E}/{path}", path.rpartition("/")[2], sha256)
            for name, (path, sha256) in _UR10E_FILES.items()
        },
    ),
}


def data_folder() -> Path:
    """Return the folder of the public sets: ``$FRICTIONPINN_DATA``, or the user's cache folder."""
    import pooch

    return Path(os.environ.get(FOLDER_VARIABLE) or pooch.os_cache("frictionpinn")).expanduser()


def fetch(name: str, only: Iterable[str] | None = None) -> dict[str, Path]:
    """Return the files of a public set, downloading those that are not in the data folder yet.

    Args:
        name: one of :data:`DATASETS`.
        only: short names of the files wanted; all if None.

    Returns:
        Short name -> path. Files already there are verified and never written to.

    Raises:
        UserError: unknown set or file, failed download, or a file whose checksum is wrong.
    """
    dataset = choose(name, DATASETS, "dataset")
    folder = data_folder() / dataset.folder
    wanted = dataset.files if only is None else {key: choose(key, dataset.files, f"{name} file") for key in only}
    return {key: _fetch_rows(folder, file) if file.rows else _fetch_bytes(folder, file) for key, file in wanted.items()}


def read_brfd(path: Path) -> np.ndarray:
    """Return the rows of a damper file, JSON or gzipped CSV, shape (n, 6), columns :data:`BRFD_COLUMNS` as recorded."""
    return np.loadtxt(_rows_text(path).splitlines(), delimiter=",", ndmin=2)


def _fetch_bytes(folder: Path, file: RemoteFile) -> Path:
    path, packed = folder / file.stored, folder / f"{file.stored}.gz"
    if packed.is_file() and not path.is_file():
        path = packed
    if not path.is_file():
        _download(file, folder, file.sha256)
    elif hashlib.sha256(_unpacked(path)).hexdigest() != file.sha256:
        raise _wrong_checksum(path)
    return path


def _unpacked(path: Path) -> bytes:
    """The bytes of a file that may have been gzipped since; none of one that cannot be unpacked."""
    try:
        return gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()
    except (EOFError, zlib.error, gzip.BadGzipFile):
        return b""


def _fetch_rows(folder: Path, file: RemoteFile) -> Path:
    packed = folder / file.stored.replace(".json", ".csv.gz")
    path = folder / file.stored
    present = next((found for found in (packed, path) if found.is_file()), None)
    if present is None:
        _download(file, folder, None)
    if _rows_sha256(present or path) == file.sha256:
        return present or path
    if present is None:
        path.unlink()
    raise _wrong_checksum(present or path)


def _download(file: RemoteFile, folder: Path, sha256: str | None) -> None:
    import pooch

    logger = pooch.get_logger()
    level = logger.level
    # pooch warns about a missing hash and prints one; the rows are checked instead.
    logger.setLevel("ERROR")
    try:
        pooch.retrieve(file.url, known_hash=sha256 and f"sha256:{sha256}", fname=file.stored, path=folder)
    except (OSError, ValueError) as error:  # requests' errors are OSErrors; a wrong hash is a ValueError
        reason = type(error).__name__ if isinstance(error, OSError) else str(error).split("\n", 1)[0][:100]
        raise UserError(
            "download failed",
            where=file.url,
            received=reason,
            fix=f"connect to the network and repeat, or put {file.stored} into {folder} "
            f"(the environment variable {FOLDER_VARIABLE} names the folder above it)",
        ) from error
    finally:
        logger.setLevel(level)


def _wrong_checksum(path: Path) -> UserError:
    return UserError(
        "wrong checksum",
        where=str(path),
        received="not the published file",
        fix=f"delete the file and repeat, or set {FOLDER_VARIABLE} to a folder with sound files",
    )


def _rows_sha256(path: Path) -> str:
    try:
        return hashlib.sha256(_rows_text(path).encode()).hexdigest()
    except (OSError, EOFError, zlib.error, ValueError, KeyError, TypeError):
        return "unreadable"


def _rows_text(path: Path) -> str:
    """Return the rows of a damper file as text, without header, in the precision that its checksum is taken of."""
    if path.suffix == ".gz":
        return gzip.decompress(path.read_bytes()).decode().replace("\r\n", "\n").partition("\n")[2]
    rows = json.loads(path.read_bytes())["data"]
    return "".join(",".join(f"{float(value):.7g}" for value in row) + "\n" for row in rows)
