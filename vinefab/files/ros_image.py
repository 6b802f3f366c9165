"""Images of occupancy grids, read as the ROS map_server reads them."""

import io
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from vinefab.core.errors import UnreadableFileError

_DEEP = {"I": 65535.0, "I;16": 65535.0, "I;16B": 65535.0, "I;16L": 65535.0}
_CHANNELS = {"1": "L", "L": "L", "LA": "RGBA", "P": "RGBA", "PA": "RGBA", "RGB": "RGB"}

Shades = NDArray[np.float32]


def read_shades(path: Path, data: bytes) -> tuple[Shades, Shades | None]:
    """Return brightness and opacity of every pixel, 0 to 1, the lowest row of the image first.

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
        shade = np.asarray(image, dtype=np.float32) / np.float32(_DEEP[image.mode])
        return np.ascontiguousarray(shade[::-1]), None
    mode = "RGBA" if image.mode == "RGBA" else _CHANNELS.get(image.mode)
    if mode is None:
        raise UnreadableFileError(
            path, f"has pixels of kind {image.mode}; allowed: grey, colour or palette images"
        )
    pixels = np.asarray(image.convert(mode), dtype=np.uint8)[::-1]
    if pixels.ndim == 2:
        return pixels.astype(np.float32) / np.float32(255.0), None
    shade = pixels[..., :3].mean(axis=2, dtype=np.float32) / np.float32(255.0)
    opaque = pixels[..., 3].astype(np.float32) / np.float32(255.0) if mode == "RGBA" else None
    has_alpha = opaque is not None and (image.mode in {"RGBA", "LA", "PA"} or opaque.min() < 1.0)
    return shade, opaque if has_alpha else None


def _open(path: Path, data: bytes) -> Image.Image:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            image = Image.open(io.BytesIO(data))
            image.load()
    except (Image.DecompressionBombWarning, Image.DecompressionBombError) as error:
        raise UnreadableFileError(path, "is an image of more than 89 million pixels") from error
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, EOFError) as error:
        raise UnreadableFileError(path, f"is not an image that can be read: {error}") from error
    return image
