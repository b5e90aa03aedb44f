# SPDX-License-Identifier: GPL-3.0-or-later
"""The checker of histories, with histories made by hand and with all orders of random ones."""

import itertools
import random
import unittest

from checker import Functions, Operation, after, check, contradiction, described, unknown

HERE, S0, S1 = 1, 2, 4


def history(*rows):
    """Rows of start, end, what, and optionally False: not answered."""
    return [Operation(f"client {i}", row[2], row[0], row[1], *row[3:]) for i, row in enumerate(rows)]


def explained(operations):
    """By definition: some order of all that was answered and some of what was not, which no pair of calls contradicts that one after the
    other was made."""
    certain = [o for o in operations if o.certain]
    uncertain = [o for o in operations if not o.certain]
    for count in range(len(uncertain) + 1):
        for taken in itertools.combinations(uncertain, count):
            for order in itertools.permutations([*certain, *taken]):
                if any(later.end < earlier.start for i, earlier in enumerate(order) for later in order[i + 1:]):
                    continue
                state = 0
                for o in order:
                    state = after(state, o.what)
                    if state is None:
                        break
                else:
                    return True
    return False


class GoodHistories(unittest.TestCase):
    def good(self, *rows):
        operations = history(*rows)
        violation = check(operations)
        self.assertIsNone(violation, violation and described([violation.operation]))
        if len(operations) < 8:
            self.assertTrue(explained(operations))

    def test_one_after_the_other(self):
        self.good((0, 1, ("see", HERE, False)), (2, 3, ("register", False)), (4, 5, ("see", HERE, True)), (6, 7, ("prepare", 0)),
                  (8, 9, ("count", 1)), (10, 11, ("refused",)), (12, 13, ("forget", 0)), (14, 15, ("delete", False, 0)),
                  (16, 17, ("register", False)))

    def test_overlapping_calls_in_either_order(self):
        self.good((0, 10, ("register", False)), (1, 9, ("see", HERE, False)), (2, 8, ("see", HERE, True)))
        self.good((0, 10, ("register", True)), (1, 9, ("register", False)))

    def test_a_look_that_needs_two_changes_before_it(self):
        self.good((0, 10, ("register", False)), (0, 10, ("prepare", 1)), (5, 6, ("see", S1, True)))

    def test_a_look_between_two_changes_that_both_ended_later(self):
        self.good((0, 1, ("register", False)), (2, 9, ("delete", True, 0)), (2, 9, ("register", False)), (3, 8, ("see", HERE, False)),
                  (10, 11, ("see", HERE, True)))

    def test_a_lost_answer_took_effect(self):
        self.good((0, 5, ("register", None), False), (1, 2, ("see", HERE, False)), (3, 4, ("see", HERE, True)))

    def test_a_lost_answer_took_effect_after_its_last_witness(self):
        self.good((0, 5, ("register", None), False), (6, 7, ("see", HERE, True)))

    def test_a_lost_answer_took_no_effect(self):
        self.good((0, 5, ("register", None), False), (6, 7, ("see", HERE, False)))

    def test_what_begins_as_another_ends_overlaps_it(self):
        self.good((0, 1, ("register", False)), (1, 2, ("see", HERE, False)))

    def test_deleting_takes_the_systems(self):
        self.good((0, 1, ("register", False)), (2, 3, ("prepare", 0)), (4, 5, ("prepare", 1)), (6, 7, ("delete", True, 2)),
                  (8, 9, ("register", False)), (10, 11, ("see", S0, False)))


class BadHistories(unittest.TestCase):
    def bad(self, *rows, because=None):
        """because: the rows that contradict each other."""
        operations = history(*rows)
        violation = check(operations)
        self.assertIsNotNone(violation)
        if len(operations) < 8:
            self.assertFalse(explained(operations))
        found = contradiction(operations, violation, 2)
        self.assertIn(violation.operation, found)
        if because is not None:
            self.assertEqual([operations.index(o) for o in found], because)

    def test_an_acknowledged_geometry_is_lost(self):
        self.bad((0, 1, ("see", HERE, False)), (2, 3, ("register", False)), (4, 5, ("prepare", 0)), (6, 7, ("see", S0, True)),
                 (8, 9, ("see", HERE, False)), because=[3, 4])

    def test_deleted_and_still_there(self):
        self.bad((0, 1, ("register", False)), (2, 3, ("see", HERE, True)), (4, 5, ("delete", True, 0)), (6, 7, ("see", HERE, True)),
                 because=[2, 3])

    def test_forgotten_and_still_there(self):
        self.bad((0, 1, ("register", False)), (2, 3, ("prepare", 0)), (4, 5, ("forget", 0)), (6, 7, ("see", S0, True)), because=[2, 3])

    def test_forgotten_twice(self):
        self.bad((0, 1, ("register", False)), (2, 3, ("prepare", 0)), (4, 9, ("forget", 0)), (5, 8, ("forget", 0)))

    def test_both_were_first(self):
        self.bad((0, 9, ("register", False)), (1, 8, ("register", False)))

    def test_a_look_back_in_time(self):
        self.bad((0, 9, ("register", False)), (1, 2, ("see", HERE, True)), (3, 4, ("see", HERE, False)), because=[1, 2])

    def test_a_lost_answer_takes_no_effect_after_its_time(self):
        self.bad((0, 5, ("register", None), False), (6, 7, ("see", HERE, False)), (8, 9, ("see", HERE, True)), because=[1, 2])

    def test_a_lost_answer_takes_effect_once(self):
        self.bad((0, 1, ("register", False)), (2, 20, ("delete", True, None), False), (3, 4, ("see", HERE, False)),
                 (5, 6, ("register", False)), (7, 8, ("see", HERE, False)))

    def test_systems_outlive_their_geometry(self):
        self.bad((0, 1, ("register", False)), (2, 3, ("prepare", 0)), (4, 5, ("delete", True, 1)), (6, 7, ("register", False)),
                 (8, 9, ("see", S0, True)))

    def test_prepared_without_a_geometry(self):
        self.bad((0, 1, ("prepare", 0)))

    def test_deleted_with_systems_although_that_was_refused(self):
        self.bad((0, 1, ("register", False)), (2, 3, ("prepare", 0)), (4, 5, ("delete", False, 0)))

    def test_a_wrong_count(self):
        self.bad((0, 1, ("register", False)), (2, 3, ("prepare", 0)), (4, 5, ("count", 2)))
        self.bad((0, 1, ("register", False)), (2, 3, ("prepare", 0)), (4, 5, ("delete", True, 0)))

    def test_what_no_state_explains(self):
        self.bad((0, 1, ("never", "INTERNAL")), because=[0])

    def test_the_contradiction_is_found_in_a_long_history(self):
        rows = []
        for i in range(200):
            rows += [(10 * i, 10 * i + 1, ("register", False)), (10 * i + 2, 10 * i + 3, ("see", HERE, True)),
                     (10 * i + 4, 10 * i + 5, ("delete", True, 0))]
        self.bad(*rows, (2000, 2001, ("see", HERE, True)), because=[599, 600])


class RandomHistories(unittest.TestCase):
    def random_operation(self, rng):
        what = rng.choice([("register", None), ("register", False), ("register", True), ("delete", True, None), ("delete", False, 0),
                           ("delete", True, 1), ("refused",), ("prepare", 0), ("prepare", 1), ("forget", 0), ("see", HERE, True),
                           ("see", HERE, False), ("see", S0, True), ("see", S0, False), ("count", 1)])
        start = rng.randrange(12)
        certain = what[0] in ("see", "count", "refused") or rng.random() < 0.7
        return Operation("someone", what if certain else unknown(what), start, start + rng.randrange(1, 6), certain)

    def test_the_same_as_by_definition(self):
        rng = random.Random(1)
        seen = {True: 0, False: 0}
        for _ in range(4000):
            operations = [self.random_operation(rng) for _ in range(rng.randrange(1, 6))]
            right = explained(operations)
            seen[right] += 1
            self.assertEqual(check(operations) is None, right, described(operations))
            if not right:
                found = contradiction(operations, check(operations), 2)
                self.assertIn(check(operations).operation, found, described(found))
        self.assertGreater(min(seen.values()), 300)

    def test_what_happened_is_explained(self):
        """Calls that take effect at a moment within their time, hundreds of them."""
        for seed in range(20):
            rng = random.Random(seed)
            operations, state, clock = [], 0, 0.0
            for _ in range(400):
                clock += rng.random()
                candidates = [("register", bool(state & 1)), ("delete", True, bin(state >> 1).count("1")), ("prepare", 0), ("prepare", 1),
                              ("forget", 0), ("forget", 1), ("see", HERE, bool(state & HERE)), ("see", S0, bool(state & S0)),
                              ("count", bin(state >> 1).count("1"))]
                what = rng.choice([one for one in candidates if after(state, one) is not None])
                state = after(state, what)
                lost = what[0] in ("register", "delete", "prepare", "forget") and rng.random() < 0.1
                operations.append(Operation("someone", unknown(what) if lost else what, clock - 4 * rng.random(), clock + 4 * rng.random(),
                                            not lost))
            self.assertIsNone(check(operations))


class Answers(unittest.TestCase):
    def test_that_differ(self):
        functions = Functions()
        self.assertIsNone(functions.differs("points of a", b"1", "ada"))
        self.assertIsNone(functions.differs("points of b", b"2", "ada"))
        self.assertIsNone(functions.differs("points of a", b"1", "ben"))
        self.assertEqual(functions.differs("points of a", b"2", "ben"), "ada")


if __name__ == "__main__":
    unittest.main(verbosity=2)
