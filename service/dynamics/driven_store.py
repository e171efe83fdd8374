"""What is known of the contact states that were met: rate matrices and, as far as they lasted, exponentials.

A store is a tuple of arrays (``driven_propagation.room_for_exponentials``): the listed contact states' numbers (-1:
free place) and their slots, how many there are, and by slot the highest level that is made, the rate matrix, and by
level the exponentials over a piece of an interval and over its doublings.
"""

from __future__ import annotations

from service.dynamics.compiled import lean, within
from service.dynamics.driven_contact import mode_number
from service.dynamics.driven_exponential import doubled, exponential, rate_matrix

SCATTER = 31
"""Spreads the numbers of contact states over the list: those that follow each other differ by powers of three."""


@within
def slot_of(machine, modes, store):
    """Where what is known of a contact state is kept: its rate matrix from the first time on."""
    A, B, push, law, forced = machine
    keys, slots, count, made, rates, _ = store
    number = mode_number(modes)
    place = place_of(keys, number)
    if keys[place] != number:
        if count[0] == len(rates):
            emptied(store)
            place = place_of(keys, number)
        slot = count[0]
        rate_matrix(A, B, push, law, forced, modes, rates[slot])
        keys[place], slots[place], made[slot] = number, slot, -1
        count[0] += 1
    return slots[place]


@lean
def make(slot, level, sizes, dt, store, scratch):
    """The exponentials of a contact state up to a level; most contact states do not last to the higher ones."""
    n, Q, X, order = sizes
    _, _, _, made, rates, powers = store
    new, term, drive, shares = scratch
    if made[slot] < 0:
        exponential(rates[slot], n, Q, X, dt, order, powers[slot, 0], (term, new, drive))
        made[slot] = 0
    for below in range(made[slot], level):
        doubled(powers[slot, below], n, Q, X, dt * (1 << below), powers[slot, below + 1], shares)
    made[slot] = max(made[slot], level)


@within
def place_of(keys, number):
    """Where the number of a contact state is listed, or else the first free place for it; there always is one."""
    place = SCATTER * number % len(keys)
    while keys[place] >= 0 and keys[place] != number:
        place = (place + 1) % len(keys)
    return place


@lean
def emptied(store):
    """Forget all exponentials."""
    keys, _, count = store[:3]
    for i in range(len(keys)):
        keys[i] = -1
    count[0] = 0
