"""Where things stand in our HDF5 files, version 1.

The root carries ``format``, ``schema_version`` and ``written_by``, and the dataset ``contents`` (JSON): the kind of
collection (``mapping``, ``sequence``, or ``noun`` for one container) and the names of its items. ``items/<k>`` is a
group for each: ``document`` (JSON: every field that is no array) and one dataset for each array, under the path of its
field. Where an array stands in the document, ``crc32`` is the checksum of its bytes in the order of C (earlier files
have none); records that grew, packed arrays and the documents carry a Fletcher sum in each chunk instead or as well.
The name of a friction law of the user's own is an object ``$law`` with the fingerprint of its function; in earlier
files it is a text.
"""

SCHEMA_VERSION = 1
"""Raised when a change makes older programs misread a file or renames what is in it; every version is read forever."""

FORMAT = "friction-ema store"
CONTENTS = "contents"
ITEMS = "items"
DOCUMENT = "document"
