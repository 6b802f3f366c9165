"""Photos and scans read from files: upright, eight bits of red, green and blue."""

import io
import math
import struct
import warnings
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError

from vinefab.core.errors import UnreadableFileError
from vinefab.core.plain_text import visible
from vinefab.model.files.shipped import read_bytes

MOST_MEGAPIXELS = 100
"""Larger pictures are refused before they are unpacked: one may be gigabytes in a file of kB."""

_MOST_BYTES = 1 << 29
_DEEP_TO_BYTE = 1.0 / 257.0
_FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)
_EXIF, _WIDTH, _HEIGHT, _FOCAL_35 = 0x8769, 0xA002, 0xA003, 0xA405
_LENSES_35MM_MM = (8.0, 800.0)


CAMERA_GAMMA = 2.2
"""Lenses mix light, and cameras store about this root of it, in which white spreads over black."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Photo:
    """A photo or a scan as a person looks at it.

    Parameters
    ----------
    name
        Of its file, for messages.
    pixels
        Red, green and blue, uint8, shape (rows, columns, 3); turned upright, transparent parts
        white. Places in it are (column, row) with the middle of the first pixel at (0.5, 0.5).
    focal_px
        Focal length by the file's EXIF data; None where it has none, or where its picture was
        cropped later.
    """

    name: str
    pixels: NDArray[np.uint8]
    focal_px: float | None = None

    @property
    def width_px(self) -> int:
        """Columns of pixels."""
        return int(self.pixels.shape[1])

    @property
    def height_px(self) -> int:
        """Rows of pixels."""
        return int(self.pixels.shape[0])


def read_photo(path: Path) -> Photo:
    """Return the photo in a PNG or JPEG file.

    Raises
    ------
    UnreadableFileError
        If it is missing, damaged, another kind of file, an animation or too large.
    """
    data = read_bytes(path, _MOST_BYTES)
    if data[4:8] == b"ftyp":
        raise UnreadableFileError(path, "is a HEIC photo or a film; save it as JPEG or PNG")
    try:
        with warnings.catch_warnings():
            # We have a limit of our own; what else Pillow warns of does not stop it from reading.
            warnings.simplefilter("ignore")
            image: Image.Image = Image.open(io.BytesIO(data), formats=("PNG", "JPEG"))
            _ensure_one_picture(path, image)
            image.load()
            focal_35mm_mm = _focal_35mm_mm(image)
            upright: Image.Image = image  # as it is where the EXIF data are damaged
            with suppress(OSError, ValueError, SyntaxError, LookupError, TypeError, struct.error):
                upright = ImageOps.exif_transpose(image)
            pixels = _rgb(upright)
    except UnidentifiedImageError as error:
        raise UnreadableFileError(path, "is not a PNG or JPEG picture, or is damaged") from error
    except Image.DecompressionBombError as error:
        raise UnreadableFileError(path, f"has more than {MOST_MEGAPIXELS} megapixels") from error
    except UnreadableFileError:
        raise
    except (OSError, ValueError, SyntaxError, EOFError, struct.error) as error:
        raise UnreadableFileError(path, f"is damaged: {error}") from error
    pixels.setflags(write=False)
    diagonal_px = math.hypot(*pixels.shape[:2])
    focal_px = focal_35mm_mm and focal_35mm_mm / _FILM_DIAGONAL_MM * diagonal_px
    return Photo(name=visible(path.name), pixels=pixels, focal_px=focal_px)


def _ensure_one_picture(path: Path, image: Image.Image) -> None:
    width, height = image.size
    if width * height > MOST_MEGAPIXELS * 1_000_000:
        problem = f"has {width} x {height} pixels; allowed: {MOST_MEGAPIXELS} megapixels"
        raise UnreadableFileError(path, problem)
    # A phone's JPEG may hold a preview behind its picture (MPO); the first is the picture.
    frames = int(getattr(image, "n_frames", 1))
    if image.format == "PNG" and frames > 1:
        raise UnreadableFileError(path, f"is an animation of {frames} pictures; allowed: one")


def _focal_35mm_mm(image: Image.Image) -> float | None:
    """Return the focal length for film of 36 x 24 mm by the EXIF data, if it is to be believed."""
    try:
        exif = image.getexif().get_ifd(_EXIF)
        taken = (float(exif.get(_WIDTH, 0)), float(exif.get(_HEIGHT, 0)))
        focal_35mm_mm = float(exif.get(_FOCAL_35, 0))
    except (OSError, ValueError, SyntaxError, LookupError, TypeError, struct.error):
        return None
    if not _LENSES_35MM_MM[0] <= focal_35mm_mm <= _LENSES_35MM_MM[1]:
        return None
    # Cropped pictures have another shape than the camera took.
    shape, taken_shape = sorted(image.size), sorted(taken)
    cropped = taken_shape[0] > 0 and not math.isclose(
        shape[1] * taken_shape[0], shape[0] * taken_shape[1], rel_tol=0.01
    )
    return None if cropped else focal_35mm_mm


def _rgb(image: Image.Image) -> NDArray[np.uint8]:
    """Return red, green and blue of each pixel of an image of any mode."""
    if image.mode.startswith(("I", "F")):
        grey = np.asarray(image, dtype=np.float64) * _DEEP_TO_BYTE
        levels = np.clip(np.round(grey), 0, 255).astype(np.uint8)
        return np.repeat(levels[..., None], 3, axis=2)
    if image.has_transparency_data:
        image = image.convert("RGBA")
        paper = Image.new("RGBA", image.size, "white")
        image = Image.alpha_composite(paper, image)
    return np.array(image.convert("RGB"))
