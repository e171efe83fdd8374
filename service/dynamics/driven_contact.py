"""Contact states of gaps, and when along a series of states one of them changes.

Contact states of a gap: 0 lower flank, 1 in the gap, 2 upper flank. A flank's approach δ and its force over k are
linear forms of z with few entries, which are listed: where they are (2·G, M), how many (2·G,), and both forms' there.

A deeper piece of a flank is met where that flank is pressed by more than a depth, and parts with it, where all pieces
together would pull. So its approach is that flank's, and its force is over the k of that one: with each gap go the one
whose flank it is a piece of (G,), itself where it is no piece, the next deeper piece (G,), -1 where there is none, and
its depth (G,) [m].
"""

from __future__ import annotations

from service.dynamics.compiled import within

CLOSE = 1e-10
"""How closely an event is found, as a share of the piece; it is passed by as much."""


@within
def pressed(flanks, g, side, z):
    """How far a flank is pressed, 0 unless it touches and pushes: unless its approach and its force, that of all pieces
    that are reached, are positive."""
    place, many, delta, force, _, deeper, depth = flanks
    row, near, push = 2 * g + side, 0.0, 0.0
    for m in range(many[row]):
        near += delta[row, m] * z[place[row, m]]
    if not near > 0.0:
        return 0.0
    for m in range(many[row]):
        push += force[row, m] * z[place[row, m]]
    piece = deeper[g]
    while piece >= 0 and near > depth[piece]:
        row = 2 * piece + side
        for m in range(many[row]):
            push += force[row, m] * z[place[row, m]]
        piece = deeper[piece]
    return near if push > 0.0 else 0.0


@within
def contact_modes(flanks, z, out):
    """Contact states of all gaps into out."""
    _, _, _, _, first, deeper, depth = flanks
    for g in range(len(out)):
        if first[g] != g:
            continue
        mode, near = 2, pressed(flanks, g, 1, z)
        if near == 0.0:
            mode, near = 0, pressed(flanks, g, 0, z)
        out[g] = mode if near > 0.0 else 1
        piece = deeper[g]
        while piece >= 0:
            out[piece] = mode if near > depth[piece] else 1
            piece = deeper[piece]


@within
def parted(deeper, g, modes):
    """The pieces of a flank behind one that touches no more let go as well, in modes."""
    piece = deeper[g]
    while piece >= 0:
        modes[piece] = 1
        piece = deeper[piece]


@within
def same(first, second):
    """Whether all contact states are the same."""
    alike = True
    for g in range(len(first)):
        alike = alike and first[g] == second[g]
    return alike


@within
def mode_number(modes):
    """Contact states of all gaps as one number."""
    number = 0
    for g in range(len(modes) - 1, -1, -1):
        number = 3 * number + modes[g]
    return number


@within
def lesser(polynomials, many, t):
    """The lesser of the polynomials of approach and force: positive while a flank touches and pushes."""
    near, push = polynomials[many - 1, 0], polynomials[many - 1, 1]
    for i in range(many - 2, -1, -1):
        near = near * t + polynomials[i, 0]
        push = push * t + polynomials[i, 1]
    return min(near, push)


@within
def crossing(polynomials, many, left):
    """First time in [0, left] at which `lesser` changes its sign: quarters, then regula falsi."""
    begin = lesser(polynomials, many, 0.0)
    a, fa = 0.0, begin
    b, fb = left, begin
    for quarter in range(1, 5):
        b = left * quarter / 4.0
        fb = lesser(polynomials, many, b)
        if (fb > 0.0) != (begin > 0.0):
            break
        a, fa = b, fb
    if (fb > 0.0) == (begin > 0.0):
        return left
    before, side = a, 0
    for trial in range(60):
        t = b - fb * (b - a) / (fb - fa)
        if not a < t < b or trial % 8 == 7:
            t = 0.5 * (a + b)
        f = lesser(polynomials, many, t)
        if (f > 0.0) == (fb > 0.0):
            b, fb = t, f
            fa *= 0.5 if side == 1 else 1.0
            side = 1
        else:
            a, fa = t, f
            fb *= 0.5 if side == -1 else 1.0
            side = -1
        if abs(t - before) <= CLOSE * left:
            break
        before = t
    return min(t + CLOSE * left, left)


@within
def polynomials_of(flanks, modes, g, side, D, many, out):
    """Approach and force of a flank along a series, into out (…, 2), the force that of all pieces that are reached; a
    piece holds while it is pressed."""
    place, entries, delta, force, first, deeper, depth = flanks
    row, piece = 2 * first[g] + side, first[g] != g
    for i in range(many):
        near, push = 0.0, 0.0
        for m in range(entries[row]):
            value = D[i, place[row, m]]
            near += delta[row, m] * value
            push += force[row, m] * value
        if piece and i == 0:
            near -= depth[g]
        out[i, 0], out[i, 1] = near, near if piece else push
    behind = deeper[g]
    while not piece and behind >= 0 and modes[behind] != 1:
        row = 2 * behind + side
        for i in range(many):
            for m in range(entries[row]):
                out[i, 1] += force[row, m] * D[i, place[row, m]]
        behind = deeper[behind]
