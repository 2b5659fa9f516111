"""CommonRoad scenarios (XML 2018b and 2020a, https://commonroad.in.tum.de) as scenarios here."""
