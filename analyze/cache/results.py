"""Cache of results: each is computed once, and read from a folder when its inputs are given again."""

from __future__ import annotations

import hashlib
import platform
import sys
from collections.abc import Callable, Mapping
from typing import TypeVar

from analyze.cache.code_version import analysis_version, hash_of_code
from analyze.cache.decoding import DecodeError, decode
from analyze.cache.encoding import encode
from analyze.cache.folder import CacheFolder, EntryError, default_folder

T = TypeVar("T")


class ResultCache:
    """Cache of results in a folder, keyed by all that they are computed from and by the code.

    An entry that is damaged, or was not written by this cache, is reported, computed again and replaced. A
    folder that cannot be written keeps nothing. A result is not kept if it or its inputs cannot be encoded
    and decoded, or if the code was changed after this cache was made.

    Args:
        folder: folder of the entries.
        warn: called with one line about an entry that cannot be used.
    """

    def __init__(self, folder: CacheFolder, warn: Callable[[str], None]) -> None:
        self._folder, self._warn = folder, warn
        # Read before the modules that compute are loaded, so that a change of the code meanwhile is noticed.
        self._code = analysis_version()

    def get(
        self,
        kind: type[T],
        inputs: object,
        label: str,
        compute: Callable[[], T],
        given: Mapping[type, object] | None = None,
    ) -> T:
        """Result of `compute`, or the one kept from an earlier call with equal inputs.

        Args:
            kind: type of the result, a dataclass that `encode` and `decode` know.
            inputs: all that the result depends on besides the code, as a value that `encode` knows.
            label: what the result is, for the list of entries, one short line.
            compute: function that computes the result; its exceptions pass and are not kept.
            given: values within the result that are known anyway, by their type; they are not kept.
        """
        try:
            key = self._key(kind, inputs)
        except TypeError:
            return compute()
        try:
            if (content := self._folder.read(key)) is not None:
                return decode(content, kind, given)
        except EntryError as error:
            self._warn(f"{error}: it is computed again")
        except DecodeError as error:
            self._warn(f"{self._folder.path}: the entry of {label} {error}: it is computed again")
        result = compute()
        self._keep(key, label, result, given or {})
        return result

    def _keep(self, key: str, label: str, result: object, given: Mapping[type, object]) -> None:
        """Write a result, if it can be read again and the code is still the one that computed it."""
        try:
            content = encode(result, tuple(given))
            decode(content, type(result), given)
        except (TypeError, DecodeError):
            return
        if hash_of_code() == self._code:
            self._folder.write(key, label, content)

    def _key(self, kind: type, inputs: object) -> str:
        # Another processor or Python may round otherwise in the last digit.
        where = f"{kind.__qualname__}\n{self._code}\n{platform.machine()}\n{sys.version_info[:2]}\n"
        return hashlib.sha256(where.encode() + encode(inputs)).hexdigest()


def user_cache(warn: Callable[[str], None]) -> ResultCache | None:
    """Cache in the user's folder; None if the user switched it off.

    Args:
        warn: called with one line about an entry that cannot be used.
    """
    folder = default_folder()
    return None if folder is None else ResultCache(CacheFolder(folder), warn)
