"""The scenario of one ego among several, as a scenario of one ego: what it drives, senses and is judged by.

Knows the models alone; neither files nor how egos are driven.
"""

from __future__ import annotations

from vve_sumo.scenario.schema import EgoSettings, FurtherEgo, Scenario

#: what a further ego's table may say of the scenario's other tables
OF_SCENARIO = ("controller", "radar", "sensors", "criteria", "end_trigger")


def alone(scenario: Scenario, one: FurtherEgo) -> Scenario:
    """Return the scenario of a further ego: its keys in place of those of [ego] and of the scenario.

    Obstacles, actors and people, which are placed along the path of [ego], are left out, as are the other egos.
    Raises pydantic's ValidationError where the keys of [ego] and its own make no ego.
    """
    given = {key: value for key in EgoSettings.model_fields if (value := getattr(one, key)) is not None}
    settings = {key: getattr(scenario.ego, key) for key in EgoSettings.model_fields} | given
    own = {key: value for key in OF_SCENARIO if (value := getattr(one, key)) is not None}
    return scenario.model_copy(
        update={"ego": EgoSettings.model_validate(settings), "egos": (), "obstacles": (), "actors": (), "people": ()}
        | own
    )
