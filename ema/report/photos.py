"""Photographs of the test and the logo of who tests, inside the report."""

from dataclasses import dataclass
from pathlib import Path

from ema.data import Campaign
from ema.messages import mark, text
from ema.report.blocks import Block, Picture, Text
from ema.report.pictures import Image

_LARGEST = 3_000_000
"""Bytes of a photo beyond which it is not put into the page."""
_SIGNATURES = {b"\xff\xd8\xff": "image/jpeg", b"\x89PNG\r\n\x1a\n": "image/png", b"GIF8": "image/gif"}


@dataclass(frozen=True)
class _Kind:
    """An image of a campaign: its width in percent of the page, and why it is not shown."""

    width: int
    unread: str
    unknown: str
    large: str


_LOGO = _Kind(
    20,
    mark("The logo {name} cannot be read: {error}."),
    mark("The logo {name} is not shown: it is neither JPEG, PNG nor GIF."),
    mark("The logo {name} is not shown: {size} MB, limit {limit} MB."),
)
_PHOTOGRAPH = _Kind(
    60,
    mark("The photograph {name} cannot be read: {error}."),
    mark("The photograph {name} is not shown: it is neither JPEG, PNG nor GIF."),
    mark("The photograph {name} is not shown: {size} MB, limit {limit} MB."),
)


def photos(campaign: Campaign) -> list[Block]:
    """The photographs of a campaign; those that cannot be shown are named with the reason."""
    return [_photo(Path(campaign.folder), name) for name in campaign.photos]


def logo(campaign: Campaign) -> Block | None:
    """The logo of a campaign, if it has one, or why it cannot be shown."""
    if not campaign.logo:
        return None
    image = _image(Path(campaign.folder), campaign.logo, _LOGO)
    return image if isinstance(image, Text) else Picture(None, image, text("Logo"), "")


def _image(folder: Path, name: str, what: _Kind) -> Image | Text:
    """The image in a file, or why it cannot be shown."""
    try:
        content = (folder / name).read_bytes()
    except OSError as error:
        return Text(text(what.unread, name=name, error=error.strerror or error), missing=True)
    mime = next((mime for start, mime in _SIGNATURES.items() if content.startswith(start)), None)
    if mime is None:
        return Text(text(what.unknown, name=name), missing=True)
    if len(content) > _LARGEST:
        sizes = {"size": f"{len(content) / 1e6:.1f}", "limit": f"{_LARGEST / 1e6:.0f}"}
        sentence = text(what.large, name=name, **sizes)
        return Text(sentence, missing=True)
    return Image(content, mime, what.width)


def _photo(folder: Path, name: str) -> Block:
    image = _image(folder, name, _PHOTOGRAPH)
    if isinstance(image, Text):
        return image
    alt = text("Photograph of the test: {name}", name=Path(name).name)
    return Picture(None, image, alt, Path(name).stem.replace("_", " "))
