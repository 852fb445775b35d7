"""Laws of sequence graphs (thesis 2.3) on random label strings, and the examples of the text."""

import numpy as np
import pytest

from policies.sequence_graph import (
    START,
    SequenceGraph,
    chain,
    fold,
    fully_connected_graph,
    global_graph,
    local_graph,
    merge,
    segments,
)

N_RANDOM = 10_000


def labels(text: str) -> list[int]:
    return [ord(letter) for letter in text]


def edges(graph: SequenceGraph) -> set[str]:
    """Edges between primitives as 'A>B', without the start node."""
    return {f"{chr(graph.labels[a])}>{chr(graph.labels[b])}" for a, b in graph.transitions if a != 0}


def random_strings(n: int, seed: int = 0):
    rng = np.random.default_rng(seed)
    for _ in range(n):
        yield rng.integers(0, rng.integers(2, 6), size=rng.integers(1, 16)).tolist()


def sequence(string: list[int]) -> list[int]:
    return [segment.label for segment in segments(string)]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("BRYRYR", {"B>R", "R>Y", "Y>R"}),
        ("AXBXBXC", {"A>X", "X>B", "B>X", "X>C"}),
        ("CXYZXYZXYD", {"C>X", "X>Y", "Y>Z", "Z>X", "Y>D"}),
        ("ABCABD", {"A>B", "B>C", "C>A", "B>D"}),
    ],
)
def test_folding_examples(text, expected):
    assert edges(fold(chain(labels(text)))) == expected


def test_a_sequence_without_repetition_stays_a_chain():
    graph = fold(chain(labels("ABCABD")))
    assert graph.labels[1:] == tuple(labels("ABCABD"))


def test_folding_frees_the_number_of_repetitions():
    graph = fold(chain(labels("ABCDEBCDEBCF")))
    assert graph.n_nodes == 7
    for repetitions in range(5):
        assert graph.accepts(labels("A" + "BCDE" * repetitions + "BCF"))
    assert not graph.accepts(labels("ABCDEF"))


def test_without_folding_the_number_of_repetitions_is_fixed():
    graph = global_graph([labels("ABCBCD")], fold_repetitions=False)
    assert graph.accepts(labels("ABCBCD"))
    assert not graph.accepts(labels("ABCBCBCD"))


def test_every_folded_graph_accepts_its_sequence_and_folding_is_idempotent():
    for string in random_strings(N_RANDOM):
        graph = fold(chain(string))
        assert graph.accepts(sequence(string))
        assert fold(graph) == graph
        assert graph.n_nodes <= len(sequence(string)) + 1


@pytest.mark.parametrize("build", [global_graph, local_graph, fully_connected_graph])
def test_every_demonstration_is_a_walk_of_its_graph(build):
    strings = list(random_strings(N_RANDOM, seed=1))
    for i in range(0, N_RANDOM, 4):
        demonstrations = strings[i : i + 4]
        graph = build(demonstrations)
        assert all(graph.accepts(sequence(string)) for string in demonstrations)
        assert graph.labels[0] == START
        assert START not in graph.labels[1:]


@pytest.mark.parametrize("match", ["label", "inputs"])
def test_transition_points_are_carried_along(match):
    strings = list(random_strings(400, seed=2))
    for i in range(0, 400, 4):
        demonstrations = strings[i : i + 4]
        graph = global_graph(demonstrations, match=match)
        assert all(graph.accepts(sequence(string)) for string in demonstrations)
        points = [(point, graph.labels[b]) for (_, b), points in graph.transitions.items() for point in points]
        expected = [((m, s.start), s.label) for m, string in enumerate(demonstrations) for s in segments(string)]
        assert sorted(points) == sorted(expected)
        for (a, _), at in graph.transitions.items():
            assert all(point.step == 0 or demonstrations[point[0]][point[1] - 1] == graph.labels[a] for point in at)


def test_no_node_has_two_successors_of_one_primitive():
    strings = list(random_strings(400, seed=3))
    for i in range(0, 400, 4):
        for graph in (global_graph(strings[i : i + 4]), local_graph(strings[i : i + 4])):
            for node in range(graph.n_nodes):
                following = [graph.labels[n] for n in graph.successors(node)]
                assert len(set(following)) == len(following)


def test_global_graph_does_not_depend_on_the_order_of_demonstrations():
    strings = list(random_strings(400, seed=4))
    for i in range(0, 400, 4):
        there, back = global_graph(strings[i : i + 4]), global_graph(strings[i : i + 4][::-1])
        assert there.labels == back.labels
        assert list(there.transitions) == list(back.transitions)


def test_merging_branches_at_the_latest_possible_point():
    graph = merge(fold(chain(labels("ABCD"), 0)), fold(chain(labels("ABEF"), 1)))
    assert graph.n_nodes == 7
    assert edges(graph) == {"A>B", "B>C", "C>D", "B>E", "E>F"}


def test_separate_branches_stay_separate():
    graph = global_graph([labels("ABCD"), labels("AECD")])
    assert graph.labels.count(ord("C")) == 2
    assert not graph.accepts(labels("ABCDCD"))


def test_demonstrations_that_end_alike_end_in_the_same_node():
    """So what one of them shows there, an error recovery, is known to all."""
    graph = global_graph([labels("ABXL"), labels("ACXL"), labels("ACXLACXL")])
    assert graph.labels.count(ord("L")) == 1
    assert graph.labels.count(ord("X")) == 2
    assert graph.accepts(labels("ABXLACXL"))
    by_inputs = global_graph([labels("ABXL"), labels("ACXL")], match="inputs")
    assert by_inputs.labels.count(ord("L")) == 2


def test_equal_inputs_are_the_rule_of_the_thesis():
    """Where one demonstration has no cycle it keeps two nodes B after A, which no feature can tell apart."""
    demonstrations = [labels("ABCBCBD"), labels("ABD")]
    by_inputs, by_label = (global_graph(demonstrations, match=match) for match in ("inputs", "label"))
    assert by_inputs.labels.count(ord("B")) == 2
    assert by_label.labels.count(ord("B")) == 1


def test_local_graph_has_one_node_per_primitive_and_merges_what_was_never_demonstrated():
    graph = local_graph([labels("ABCBD")])
    assert sorted(graph.labels[1:]) == labels("ABCD")
    assert graph.accepts(labels("ABD"))
    assert not global_graph([labels("ABCBD")]).accepts(labels("ABD"))


def test_fully_connected_graph_allows_everything():
    graph = fully_connected_graph([labels("ABC")])
    assert len(graph.transitions) == 3 + 3 * 2
    assert graph.accepts(labels("CABAC"))


def test_several_first_primitives_leave_the_explicit_start():
    graph = global_graph([labels("ABC"), labels("BC")])
    assert len(graph.successors(0)) == 2


def test_equal_neighbours_collapse():
    assert [tuple(s) for s in segments([3, 3, 1, 1, 1, 3])] == [(3, 0, 2), (1, 2, 5), (3, 5, 6)]


def test_only_demonstrations_with_an_end_end_in_the_same_node():
    assert global_graph([labels("ABX"), labels("ADX")]).n_nodes == 5
    assert global_graph([labels("ABX"), labels("ADX")], broken_off=[1]).n_nodes == 6


def test_graph_round_trips_through_its_dictionary():
    graph = global_graph([labels("ABCBCD"), labels("ABD")])
    assert SequenceGraph.from_dict(graph.to_dict()) == graph


def test_nodes_and_edges_are_named():
    graph = global_graph([[0, 1, 2, 1, 2, 0]])
    assert graph.node_names(["reach", "twist", "release"]) == ["start", "reach", "twist", "release", "reach (2)"]
    assert graph.to_networkx().number_of_edges() == len(graph.transitions)
