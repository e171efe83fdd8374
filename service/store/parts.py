"""What a value consists of beside its number: steps, the map along the rack, and the model's other parameters."""

from __future__ import annotations

from dataclasses import replace

from sqlalchemy import Connection, RowMapping, select

from service.backlash.meaning import by_direction
from service.backlash.results import ByProduct, PlaceValue, Reason
from service.store import statements, tables
from service.store.database import Database
from service.store.records import ByProductRecord, ValueRecord


def whole(connection: Connection, value: ValueRecord) -> ValueRecord:
    """The value with its steps, its map and its by-products."""
    result = replace(
        value.outcome.result,
        steps=statements.steps(connection, value.id),
        by_place=_places(connection, value.id),
        by_products=_by_products(connection, value.id),
    )
    result = replace(result, by_direction=by_direction(result))
    return replace(value, outcome=replace(value.outcome, result=result))


def _places(connection: Connection, value_id: int) -> tuple[PlaceValue, ...]:
    places = tables.places
    query = select(places).where(places.c.value_id == value_id).order_by(places.c.place_index)
    return tuple(_place(row) for row in connection.execute(query).mappings())


def _place(row: RowMapping) -> PlaceValue:
    ends = row["interval_low_m"], row["interval_high_m"]
    return PlaceValue(
        position=row["position_m"],
        verdict=row["verdict"],
        reason=None if row["reason"] is None else Reason(row["reason"]),
        detail=row["detail"],
        backlash=row["backlash_m"],
        interval_95=None if None in ends else ends,
    )


def _by_products(connection: Connection, value_id: int) -> tuple[ByProduct, ...]:
    products = tables.by_products
    query = select(products).where(products.c.value_id == value_id).order_by(products.c.id)
    return tuple(_by_product(row) for row in connection.execute(query).mappings())


def _by_product(row: RowMapping) -> ByProduct:
    return ByProduct(row["name"], row["value"], row["std"], row["unit"])


class PartStore:
    """Reads the maps and the histories of the by-products of one database."""

    def __init__(self, database: Database) -> None:
        """Read from an open database, which stays the caller's to close."""
        self._database = database

    def places(self, value_id: int) -> tuple[PlaceValue, ...]:
        """Return the map along the rack of one value."""
        with self._database.reading() as connection:
            return _places(connection, value_id)

    def by_products(self, axis: str, limit: int = 100) -> tuple[ByProductRecord, ...]:
        """Return what the axis' latest accepted, reported values found beside the backlash, the newest first."""
        values = statements.reported(axis).where(tables.backlash_values.c.verdict == "ok")
        with_products = select(tables.by_products.c.value_id)
        latest = (
            values.where(tables.backlash_values.c.id.in_(with_products))
            .order_by(tables.backlash_values.c.measured_at_utc.desc(), tables.backlash_values.c.id.desc())
            .limit(limit)
        )
        with self._database.reading() as connection:
            found = connection.execute(latest).mappings().all()
            return tuple(
                ByProductRecord(row["run_id"], row["measured_at_utc"], product)
                for row in found
                for product in _by_products(connection, row["id"])
            )
