# SPDX-License-Identifier: GPL-3.0-or-later
"""Decides whether what many clients saw of a store can be explained by calls that took effect one after the other.

Linearizability after Wing and Gong, with the memoization of Lowe: every call took effect at one moment between its beginning and its end,
and each answer is what the calls before that moment explain. Systems belong to a geometry, and geometries know nothing of each other, so
each geometry with its systems is an object of its own: a history is linearizable if that of each object is.

The state of an object is a number: bit 0 says that the geometry is registered, bit 1 + k that system k is. All else that a server answers is
a function of what was asked, and is compared by `Functions`.
"""

import itertools

# What a call does to an object and what its answer says: Operation.what is one of these with its arguments.
#   ("register", existed)     the geometry is there from now on; whether it was before (None: not told)
#   ("delete", force, count)  geometry and systems are gone; so many systems went with it (None: not told), none unless force
#   ("refused",)              a delete without force found systems
#   ("prepare", k)            system k is there from now on, and its geometry was
#   ("forget", k)             system k was there and is gone
#   ("see", bit, there)       something is there, or is not
#   ("count", n)              so many systems are there
#   ("never", text)           no state explains this answer
READS = frozenset(("refused", "see", "count", "never"))


def after(state, what):
    """The state that follows; None where the answer is not that of this state."""
    kind = what[0]
    if kind == "see":
        return state if bool(state & what[1]) == what[2] else None
    if kind == "register":
        return state | 1 if what[1] is None or what[1] == bool(state & 1) else None
    if kind == "prepare":
        return state | 2 << what[1] if state & 1 else None
    if kind == "forget":
        bit = 2 << what[1]
        return state & ~bit if state & bit else None
    if kind == "count":
        return state if bin(state >> 1).count("1") == what[1] else None
    if kind == "delete":
        systems = bin(state >> 1).count("1")
        fits = state & 1 and (what[1] or systems == 0) and what[2] in (None, systems)
        return 0 if fits else None
    if kind == "refused":
        return state if state & 1 and state >> 1 else None
    if kind == "never":
        return None
    raise ValueError(kind)


class Operation:
    """One call, or one of the answers that it gave, on one object, from `start` to `end`. One that is not `certain` was not answered: it
    took effect once until `end`, or never."""

    __slots__ = ("who", "what", "start", "end", "certain", "slot", "note")

    def __init__(self, who, what, start, end, certain=True, note=""):
        self.who, self.what, self.start, self.end, self.certain, self.note = who, what, start, end, certain, note
        self.slot = None

    @property
    def reads(self):
        return self.what[0] in READS


class Violation:
    """No order of the operations explains `operation`; `before` is what the object may have been right before that ended."""

    def __init__(self, operation, before):
        self.operation, self.before = operation, before


class Search:
    """The states that an object may have, with what took effect of the calls under way in each: a set of pairs of a state and of a number
    with a bit for each such call."""

    def __init__(self, states):
        self.configurations = {(state, 0) for state in states}
        self.under_way = {}  # slot -> operation
        self.free = []
        self.order()

    def start(self, operation):
        operation.slot = self.free.pop() if self.free else len(self.under_way)
        self.under_way[operation.slot] = operation
        self.order()
        if operation.reads:
            self.configurations = {(state, self.seen(state, done)) for state, done in self.configurations}

    def seen(self, state, done):
        """What only looks takes effect as soon as it can: that rules nothing out."""
        for slot, operation in self.under_way.items():
            if operation.reads and not done >> slot & 1 and after(state, operation.what) is not None:
                done |= 1 << slot
        return done

    def end(self, operation):
        """False when nothing is left that explains the operation."""
        bit = 1 << operation.slot
        left, known = set(), set()
        todo = list(self.configurations)
        while todo:
            configuration = todo.pop()
            if configuration in known:
                continue
            known.add(configuration)
            state, done = configuration
            if done & bit:
                left.add(configuration)
                continue
            if not operation.certain:
                left.add(configuration)
            tried = set()
            for slot, other in self.choices:
                if done >> slot & 1 or other.what in tried:
                    continue
                if not other.certain:
                    tried.add(other.what)  # of calls alike that were not answered, that which has the least time left
                following = after(state, other.what)
                if following is not None:
                    todo.append((following, self.seen(following, done | 1 << slot)))
        if not left:
            return False
        del self.under_way[operation.slot]
        self.free.append(operation.slot)
        self.order()
        self.configurations = self.weakest({(state, done & ~bit) for state, done in left})
        return True

    def order(self):
        """What may change the state next: first what was answered."""
        changing = [(not o.certain, o.end, slot) for slot, o in self.under_way.items() if not o.reads]
        self.choices = [(slot, self.under_way[slot]) for _, _, slot in sorted(changing)]
        self.uncertain = sum(1 << slot for slot, o in self.choices if not o.certain)

    def weakest(self, configurations):
        """Without those that another one makes needless, in which fewer calls without an answer have taken effect: those still may."""
        groups = {}
        for state, done in sorted(configurations, key=lambda c: bin(c[1] & self.uncertain).count("1")):
            kept = groups.setdefault((state, done & ~self.uncertain), [])
            if not any(other & done == other for other in kept):
                kept.append(done)
        return {(state, done) for (state, _), kept in groups.items() for done in kept}

    def states(self):
        return {state for state, _ in self.configurations}


def check(operations, states=(0,)):
    """None, or the violation that shows first. `states`: what the object may be before all."""
    search = Search(states)
    # What begins at the moment at which another ends is taken as overlapping: that rules nothing out.
    events = sorted(itertools.chain(((o.start, 0, i, o) for i, o in enumerate(operations)),
                                    ((o.end, 1, i, o) for i, o in enumerate(operations))), key=lambda event: event[:3])
    for _, ends, _, operation in events:
        if not ends:
            search.start(operation)
        elif not search.end(operation):
            return Violation(operation, search.states())
    return None


def contradiction(operations, violation, systems):
    """The fewest of the latest operations that cannot be explained whatever the object was before, and whatever the others did: what has to
    be looked at."""
    last = violation.operation
    earlier = sorted((o for o in operations if o is not last and o.start <= last.end), key=lambda o: -o.start)
    anything = [0] + [1 | 2 * bits for bits in range(1 << systems)]

    def fails(needed):
        """What is not needed may have taken effect or not."""
        opening = min(o.start for o in needed)
        there = []
        for o in [*earlier, last]:
            if o.end < opening or (o.reads and o not in needed):
                continue
            start, end = max(o.start, opening), min(o.end, last.end)
            known = o in needed and o.certain and o.start >= opening and o.end <= last.end
            if known or not o.reads:
                what = o.what if known else unknown(o.what)
                there.append(Operation(o.who, what, start, end, known))
        return check(there, anything) is not None

    needed = [last]
    for o in earlier:
        if fails(needed):
            break
        needed.append(o)
    else:
        if not fails(needed):
            return sorted([*earlier, last], key=lambda o: o.start)  # it takes all of them, from the very beginning
    for o in list(needed):
        without = [other for other in needed if other is not o]
        if o is not last and fails(without):
            needed = without
    return sorted(needed, key=lambda o: o.start)


def unknown(what):
    """The same effect, without what the answer said."""
    if what[0] == "register":
        return ("register", None)
    if what[0] == "delete":
        return ("delete", what[1], None)
    return what


def described(operations, zero=0.0):
    lines = []
    for o in operations:
        end = "       ?" if not o.certain else f"{o.end - zero:8.4f}"
        lines.append(f"  {o.start - zero:9.4f} .. {end}  {o.who:<10} {' '.join(str(part) for part in o.what)}  {o.note}".rstrip())
    return "\n".join(lines)


class Functions:
    """Answers that depend on the question alone."""

    def __init__(self):
        self.known = {}

    def differs(self, question, answer, who):
        """None, or who was answered differently before."""
        value, first = self.known.setdefault(question, (answer, who))
        return None if value == answer else first
