"""What of a file a scenario here cannot say: raised where it is read, kept where it may be left out."""

from __future__ import annotations

from vve_sumo.bridges.scenario_import.xml_tree import Element


class NotTakenError(Exception):
    """What a scenario here cannot say: the element, and why."""

    def __init__(self, element: Element, reason: str) -> None:
        super().__init__(f"{element.where}: {reason}")
        self.element, self.reason = element, reason


class Problems:
    """What is not taken, in the file's order, each once."""

    def __init__(self) -> None:
        self.found: list[str] = []
        self.notes: list[str] = []  #: what is taken otherwise than it stands there

    def add(self, error: NotTakenError) -> None:
        """Take down one thing that is not taken."""
        if (text := str(error)) not in self.found:
            self.found.append(text)

    def note(self, text: str) -> None:
        """Take down what somebody who imports should know."""
        if text not in self.notes:
            self.notes.append(text)
