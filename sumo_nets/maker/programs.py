"""Programs of lights. A green is written as `{edge: directions}` and becomes a state of letters."""

import re

from .network import element, links

YELLOW_S = 3
ALL_RED_S = 2
CYCLE_S, LONGEST_CYCLE_S = {2: 64, 3: 80, 4: 96}, 110  # by number of greens, for `retimed`
LEAST_GREEN_S = 8
PROGRAM = re.compile(r"(<tlLogic [^>]*>\n)(.*?)(    </tlLogic>)", re.DOTALL)
PHASE = re.compile(r'duration="(\d+)"\s+state="(\w+)"')


def green_state(links, green):
    """Returns the letters of a green: `G` where a car has the right of way, `g` where it gives way.

    `green` maps an edge towards the light to the directions that may go: `s`, `r`, `l`, or `L` for a left turn that
    gives way to the traffic from the other side.
    """
    letters = ["r"] * (1 + max(index for index, _, _ in links))
    for index, edge, direction in links:
        if direction in green.get(edge, ""):
            letters[index] = "G"
        elif direction.upper() in green.get(edge, ""):
            letters[index] = "g"
    return "".join(letters)


def program(light, links, greens, offset_s=0, all_red_s=0):
    """Returns a static program: `greens` are pairs of a duration in seconds and a green, in their order.

    Links that lose green are yellow before. Where nobody stays green, all are red for `all_red_s` after it.
    """
    states = [(seconds, green_state(links, green)) for seconds, green in greens]
    phases = []
    for (seconds, state), (_, after) in zip(states, states[1:] + states[:1]):
        phases.append((seconds, state))
        ends = [now in "Gg" and then == "r" for now, then in zip(state, after)]
        phases.append((YELLOW_S, "".join("y" if end else now for end, now in zip(ends, state))))
        if all_red_s and all(end for end, now in zip(ends, state) if now in "Gg"):
            phases.append((all_red_s, "r" * len(state)))
    rows = [element("phase", {"duration": seconds, "state": state}) for seconds, state in phases]
    return element("tlLogic", {"id": light, "type": "static", "programID": "0", "offset": offset_s}, rows)


def with_short_reds(net):
    """Returns the network without long reds: what netconvert fills a cycle up with goes to the longest greens.

    A phase that is red for all lasts `ALL_RED_S` at most. The cycle stays as long as it was.
    """

    def shorter(found):
        head, rows, tail = found.groups()
        phases = [[int(seconds), state] for seconds, state in PHASE.findall(rows)]
        spare = 0
        for phase in phases:
            if set(phase[1]) == {"r"} and phase[0] > ALL_RED_S:
                spare += phase[0] - ALL_RED_S
                phase[0] = ALL_RED_S
        if spare == 0:
            return found[0]
        longest = max(seconds for seconds, _ in phases)
        greens = [phase for phase in phases if phase[0] == longest]
        for second in range(spare):
            greens[second % len(greens)][0] += 1
        rows = "".join(f'        <phase duration="{seconds}" state="{state}"/>\n' for seconds, state in phases)
        return head + rows + tail

    return PROGRAM.sub(shorter, net)


def with_more_greens(net, dice):
    """Returns the network with further greens, as programs of real towns have them: in each an edge has red already.

    Some lights get none, others many.
    """
    edges = {light: {index: edge for index, edge, _ in found} for light, found in links(net).items()}

    def richer(found):
        head, rows, tail = found.groups()
        of_link, chance = edges[re.search('id="([^"]*)"', head)[1]], dice.choose({0: 4, 0.4: 2, 0.8: 1})
        phases = [(int(seconds), state) for seconds, state in PHASE.findall(rows)]
        result = []
        for (seconds, state), (_, after) in zip(phases, phases[1:] + phases[:1]):
            if result:
                # What has red already is not yellow.
                state = "".join("r" if (before, letter) == ("r", "y") else letter
                                for before, letter in zip(result[-1][1], state))
            result.append((seconds, state))
            while dice.next() < chance and (ending := ends_early(state, after, of_link, dice)):
                lengths = (max(seconds - LEAST_GREEN_S, LEAST_GREEN_S), YELLOW_S, LEAST_GREEN_S)
                states = [state] + ["".join(letter if index in ending else kept for index, kept in enumerate(state))
                                    for letter in "yr"]
                result[-1:] = zip(lengths, states)
                seconds, state = result[-1]
        rows = "".join(f'        <phase duration="{seconds}" state="{state}"/>\n' for seconds, state in result)
        return head + rows + tail

    return PROGRAM.sub(richer, net)


def ends_early(state, after, of_link, dice):
    """Returns the open links of an edge that may get red before the others: they end with this green anyway."""
    opened = {}
    for index, letter in enumerate(state):
        if letter in "Gg" and index in of_link:
            opened.setdefault(of_link[index], []).append(index)
    ending = {edge: 1 for edge, indices in opened.items() if all(after[index] not in "Gg" for index in indices)}
    if "y" in state or len(opened) < 2 or not ending:
        return []
    return opened[dice.choose(ending)]


def with_programs(net, programs):
    """Returns the network with other programs; `programs` maps a light to the text of its program."""
    for light, text in programs.items():
        pattern = rf'<tlLogic id="{re.escape(light)}".*?</tlLogic>'
        net, count = re.subn(pattern, text.replace("\n", "\n    "), net, flags=re.DOTALL)
        assert count == 1, f"{light} has one program"
    return net


def retimed(net, needs):
    """Returns the network with a cycle by the number of greens, and greens by what they are needed for.

    `needs` maps a light to `{state: hours}`. A green that is not in it has the least length.
    """

    def timed(found):
        head, rows, tail = found.groups()
        phases = [[int(seconds), state] for seconds, state in PHASE.findall(rows)]
        needed = needs.get(re.search('id="([^"]*)"', head)[1], {})
        weights = {number: needed.get(state, 0) for number, (_, state) in enumerate(phases)
                   if re.search("[Gg]", state) and "y" not in state}
        left = CYCLE_S.get(len(weights), LONGEST_CYCLE_S) - LEAST_GREEN_S * len(weights)
        left -= sum(seconds for number, (seconds, _) in enumerate(phases) if number not in weights)
        total = sum(weights.values())
        for number, weight in weights.items():
            share = weight / total if total else 1 / len(weights)
            phases[number][0] = LEAST_GREEN_S + round(max(0, left) * share)
        rows = "".join(f'        <phase duration="{seconds}" state="{state}"/>\n' for seconds, state in phases)
        return head + rows + tail

    return PROGRAM.sub(timed, net)
