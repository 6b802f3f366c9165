"""Images of occupancy grids, read as the ROS map_server reads them."""

import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from vinefab.core.errors import UnreadableFileError

_DEEP = ("I", "I;16", "I;16B", "I;16L")
_DEEP_TO_BYTE = 1.0 / 257.0
_GREY = ("1", "L")
_COLOUR = ("LA", "P", "PA", "RGB", "RGBA")

Values = NDArray[Any]
"""Numbers from 0 to 255; whole ones (uint8) for grey images."""


def read_values(path: Path, data: bytes) -> tuple[Values, Values | None]:
    """Return brightness and opacity of every pixel, 0 to 255, the image's lowest row first.

    Brightness is the mean of red, green and blue.

    Parameters
    ----------
    path
        Named in errors.
    data
        The file's content: PGM, PNG, BMP or another image that Pillow reads.

    Returns
    -------
    tuple
        Two arrays of shape (rows, columns); the second is None when the image has no
        transparency.

    Raises
    ------
    UnreadableFileError
        If this is no image, a damaged or a gigantic one, or has an unusual kind of pixels.
    """
    image = _open(path, data)
    if image.mode in _DEEP:
        return np.asarray(image, dtype=np.float64)[::-1] * _DEEP_TO_BYTE, None
    if image.mode in _GREY:
        return np.asarray(image.convert("L"), dtype=np.uint8)[::-1], None
    if image.mode not in _COLOUR:
        raise UnreadableFileError(
            path, f"has pixels of kind {image.mode}; allowed: grey, colour or palette images"
        )
    pixels = np.asarray(image.convert("RGBA"), dtype=np.float64)[::-1]
    opacity = pixels[..., 3] if image.has_transparency_data else None
    return pixels[..., :3].mean(axis=2), opacity


def _open(path: Path, data: bytes) -> Image.Image:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            image = Image.open(io.BytesIO(data))
            image.load()
    except (Image.DecompressionBombWarning, Image.DecompressionBombError) as error:
        raise UnreadableFileError(path, "is an image of more than 89 million pixels") from error
    except UnidentifiedImageError as error:
        raise UnreadableFileError(path, "is not an image; allowed: PGM, PNG, BMP") from error
    except (OSError, ValueError, SyntaxError, EOFError) as error:
        raise UnreadableFileError(path, f"is not an image that can be read: {error}") from error
    return image
