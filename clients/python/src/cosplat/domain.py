"""Where processes meet: a root folder, a prefix of files in shared memory, and the iceoryx2 node that joins them."""

from __future__ import annotations

import os
import re
import secrets
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import iceoryx2 as iox2

from .errors import BadName, DomainUnusable

SHARED_MEMORY = Path("/dev/shm")
ICEORYX2_VERSION = "0.10.0"

# Section 7 of the wire format: the one file whose name others can foretell, and what it begins with.
_COUNTER = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5_node.0_10_0.global_mgmt"
_COUNTER_HEAD = (10 << 16).to_bytes(8, "little")
_COUNTER_LENGTH = 16


@dataclass(frozen=True)
class Domain:
    """A group of processes that see each other's sessions, and nobody else's."""

    root: Path
    """Root folder, of this user alone."""

    @staticmethod
    def from_env() -> Domain:
        """The domain that `COSPLAT_DOMAIN` names: unset for the user's own, an absolute path, or a short name.

        Raises BadName for any other value.
        """
        return Domain.named(os.environ.get("COSPLAT_DOMAIN", ""))

    @staticmethod
    def named(name: str) -> Domain:
        """The domain of a `COSPLAT_DOMAIN` with this value; empty for the user's own.

        Raises BadName when it is neither an absolute path nor 1 to 12 of the characters a-z A-Z 0-9 - _.
        """
        if name.startswith("/"):
            return Domain(Path(name))
        if name and not re.fullmatch(r"[A-Za-z0-9_-]{1,12}", name):
            raise BadName(f"{name!r} is not a domain name: expected 1 to 12 of the characters a-z A-Z 0-9 - _")
        return Domain(Path(f"/tmp/cosplat-{os.getuid()}" + (f"-{name}" if name else "")))

    @property
    def prefix(self) -> str:
        """Prefix of every file in shared memory."""
        return f"{self.root.name}_"

    def config(self) -> Any:
        """The configuration of iceoryx2."""
        config = iox2.config.default()
        try:
            config.global_cfg.root_path = iox2.Path.new(str(self.root))
            config.global_cfg.prefix = iox2.FileName.new(self.prefix)
        except iox2.SemanticStringError as error:
            raise BadName(f"the root path {self.root} is not usable ({error})") from None
        return config

    def join(self, role: str) -> Any:
        """A node named `cosplat-ROLE`. Raises DomainUnusable or BadName."""
        # Refused opens are normal while a client waits for a server, and our errors say more.
        iox2.set_log_level_from_env_or(iox2.LogLevel.Fatal)
        self._claim_root()
        self._claim_counter()
        config = self.config()
        try:
            name = iox2.NodeName.new(f"cosplat-{role}")
        except Exception as error:
            raise BadName(f"the role {role!r} is not a node name ({error})") from None
        builder = iox2.NodeBuilder.new().name(name).config(config)
        builder = builder.signal_handling_mode(iox2.SignalHandlingMode.Disabled)
        try:
            return builder.create(iox2.ServiceType.Ipc)
        except iox2.NodeCreationFailure as error:
            raise DomainUnusable(f"cannot join the domain at {self.root}: {error}") from None

    def sessions(self) -> dict[str, int]:
        """Sessions that are served, with the process ids of their servers."""
        found = {}
        for service in iox2.Service.list(self.config(), iox2.ServiceType.Ipc):
            match = re.fullmatch(r"cosplat/([^/]+)/hello", service.name().to_string())
            if match is None:
                continue
            for node in service.nodes():
                if isinstance(node, iox2.NodeState.Alive) and node[0].details.name.as_str() == "cosplat-server":
                    found[match[1]] = int(node[0].details.process_id)
        return found

    def other_transports(self) -> list[str]:
        """Releases of iceoryx2 other than ours that left their marks."""
        names = (file.name for file in SHARED_MEMORY.glob(f"{self.prefix}*.global_mgmt"))
        releases = {name.removesuffix(".global_mgmt").rpartition(".")[2].replace("_", ".") for name in names}
        return sorted(releases - {ICEORYX2_VERSION})

    def _claim_root(self) -> None:
        """Makes the root folder for this user alone, or checks that it is."""
        try:
            self.root.mkdir(mode=0o700, parents=True, exist_ok=True)
            found = self.root.lstat()
        except OSError as error:
            raise DomainUnusable(f"the folder {self.root} cannot be used: {error}") from None
        if not stat.S_ISDIR(found.st_mode):
            raise DomainUnusable(f"{self.root} is a link or a file, expected a folder")
        if found.st_uid != os.getuid():
            raise DomainUnusable(f"the folder {self.root} belongs to user {found.st_uid}, expected user {os.getuid()}")
        if found.st_mode & 0o077:
            raise DomainUnusable(
                f"the folder {self.root} has mode {found.st_mode & 0o777:03o}, expected 700, so that nobody else can enter"
            )
        stranger = self._stranger()
        if stranger is not None:
            raise DomainUnusable(
                f"the folder {self.root} holds {stranger!r} and is no domain: expected an empty or a new folder"
            )

    def _stranger(self) -> str | None:
        """Something in the root folder that whoever joins does not make, where it is no domain."""
        made = [(self.root / name).is_dir() for name in ("nodes", "services")]
        if all(made) or (self.root / "config" / "iceoryx2.toml").is_file():
            return None
        ours = re.compile(r"nodes|services|config|.*\.event|session-.*\.lock")
        return next((name for name in os.listdir(self.root) if not ours.fullmatch(name)), None)

    def _claim_counter(self) -> None:
        """Makes the file from which iceoryx2 numbers its nodes, for this user alone, where it is missing or unsound."""
        path = SHARED_MEMORY / (self.prefix + _COUNTER)
        try:
            found = path.lstat()
            if found.st_uid != os.getuid():
                raise DomainUnusable(f"the file {path} belongs to user {found.st_uid}, expected user {os.getuid()}")
            is_plain = stat.S_ISREG(found.st_mode) and stat.S_IMODE(found.st_mode) == 0o600
            if is_plain and found.st_size == _COUNTER_LENGTH and path.read_bytes().startswith(_COUNTER_HEAD):
                return
        except FileNotFoundError:
            pass
        new = SHARED_MEMORY / f"{self.prefix}{secrets.token_hex(20)}_new"
        handle = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "wb") as file:
            file.write(_COUNTER_HEAD.ljust(_COUNTER_LENGTH, b"\0"))
        # In one go: others are joining.
        new.rename(path)
