"""What can be wrong with the store.

StoreError
├── StoreCorruptError     the file is damaged: a worn disk or a power cut below SQLite's feet
├── StoreVanishedError    the file is gone though backups of it exist: a wrong path, an unmounted disk, a slip
├── StoreInUseError       another Flankwatch process is the writer
├── StoreTooNewError      a newer Flankwatch has written it
├── AlreadyDecidedError   a model revision was accepted or rejected before
└── UnknownRecordError    a run, axis or alarm was named that is not there
"""

from __future__ import annotations


class StoreError(Exception):
    """The store refuses; the message says what failed, why as a rule, and what to do."""


class StoreCorruptError(StoreError):
    """The file is damaged. Nothing is started on it: an empty or torn history raises no alarm."""


class StoreVanishedError(StoreError):
    """The file is absent where its backups prove that it once was there."""


class StoreInUseError(StoreError):
    """Another process holds the writer's lock."""


class StoreTooNewError(StoreError):
    """The file's revision is not among the migrations of this installation."""


class AlreadyDecidedError(StoreError):
    """A decision about a model revision is made once; another finding gets a revision of its own."""


class UnknownRecordError(StoreError):
    """No such axis, run, alarm, explanation or revision."""
