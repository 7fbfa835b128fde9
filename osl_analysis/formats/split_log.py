"""The files of one recording of ROS, one after the other, as one log."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode

from osl_analysis.formats.mcap.chunk import MessageBlock
from osl_analysis.formats.mcap.damage import Damage
from osl_analysis.formats.mcap.declared import Declared, Meaning, meaning_of
from osl_analysis.formats.mcap.limits import Budget
from osl_analysis.formats.message_file import MessageFile


@dataclass
class SplitLog:
    """The parts of one recording, one after the other. A topic has one channel in all of them."""

    path: Path
    """Their folder."""
    parts: Sequence[MessageFile]
    """The files, in the order of recording."""
    counts: Counter[str] | None
    """Messages of each topic in all of them, as a description says; None where each part counts its own."""
    budget: Budget
    """The size of all."""
    numbers: dict[tuple[Meaning, Meaning], int] = field(default_factory=dict)
    """Channel by what it means: topic, encoding and definition of its messages."""
    declared: Declared = field(default_factory=Declared)
    """The channels; complete once the blocks are read."""
    damage: Damage = field(default_factory=lambda: Damage(finished=True))
    """Losses; complete once the blocks are read."""
    kind: str = "bag"
    """What it is, for messages."""

    def blocks(self) -> Iterator[MessageBlock]:
        """The messages of all parts. Call it once.

        Raises
        ------
        InputError
            A part cannot be read.
        """
        for part in self.parts:
            for block in part.blocks():
                known = np.unique(block.channel).tolist()
                number_of = np.zeros(1 << 16, np.uint16)
                number_of[known] = [self.number(part, one) for one in known]
                yield replace(block, channel=number_of[block.channel])
            self.count(part)
        if self.counts is None:
            self.add_declared()
            return
        self.damage.declared_messages = self.counts.total()
        topics = Counter(channel.topic for channel in self.declared.channels.values())
        if max(topics.values(), default=0) < 2:
            counts = self.counts
            self.damage.declared = Counter({c.id: counts[c.topic] for c in self.declared.channels.values()})

    def add_declared(self) -> None:
        """What all parts declare together, if each of them declares it."""
        messages, chunks, of_channels = 0, 0, Counter[int]()
        for part in self.parts:
            own = part.damage
            if own.declared_messages is None or own.declared is None or own.declared_chunks is None:
                return
            messages += own.declared_messages
            chunks += own.declared_chunks
            for channel, count in own.declared.items():
                of_channels[self.number(part, channel)] += count
        self.damage.declared_messages, self.damage.declared_chunks = messages, chunks
        self.damage.declared = of_channels

    def number(self, part: MessageFile, own: int) -> int:
        """The channel, in all parts, of a part's own channel."""
        channel = part.declared.channels[own]
        schema = part.declared.schemas.get(channel.schema_id)
        said = meaning_of(replace(channel, schema_id=0)), meaning_of(schema) if schema else ()
        number = self.numbers.setdefault(said, len(self.numbers))
        if number not in self.declared.channels:
            if schema:
                self.declared.take(Opcode.SCHEMA, replace(schema, id=number + 1), provisional=False)
            one = replace(channel, id=number, schema_id=number + 1 if schema else 0)
            self.declared.take(Opcode.CHANNEL, one, provisional=False)
        return number

    def count(self, part: MessageFile) -> None:
        """Add the losses of a part that was read, and its topics without messages."""
        own, all_of = part.damage, self.damage
        number_of = {one: self.number(part, one) for one in sorted(part.declared.channels)}
        for counts, total in (
            (own.read, all_of.read),
            (own.indexed_lost, all_of.indexed_lost),
        ):
            total.update(Counter({number_of[one]: count for one, count in counts.items() if one in number_of}))
        all_of.finished &= own.finished
        all_of.gaps |= own.gaps
        all_of.uncounted |= own.uncounted
        all_of.verified += own.verified
        all_of.chunks += own.chunks
        all_of.chunks_lost += own.chunks_lost
        all_of.bytes += own.bytes
        all_of.bytes_lost += own.bytes_lost
        for remark in own.remarks:
            all_of.remark(f"{part.path.name}: {remark}")
