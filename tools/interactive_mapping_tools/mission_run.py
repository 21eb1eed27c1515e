# SPDX-License-Identifier: BSD-3-Clause
"""Reads what a mission left in its run folder, however it ended. A module of report_mission.py and plot_mission.py."""

import json
import math
import pathlib
import re

# What the mission does, in words, by the states of mission.jsonl (pick_mission's docs).
ACTIVITIES = (
    ("drives", ("drive",)),
    ("picks and stows", ("pick", "stow", "let_go")),
    ("plans the arm's motions", ("plan_pick", "plan_stow", "plan_clear")),
    ("moves the arm out of view", ("clear",)),
    ("is unloaded", ("unload",)),
    ("looks", ("look", "detect")),
    ("chooses where to go", ("select", "report")),
    ("waits or recovers", ("wait", "recover", "halting")),
    ("is interrupted", ("paused", "held", "idle")),
)
ABOUT_A_BRICK = ("plan_pick", "pick", "plan_stow", "stow", "let_go")  # states
MAX_DEPTH = 50  # of JSON; what the mission writes has 5 levels
FACTORS = ("manipulability", "pick_order", "travel", "uncertainty", "frontier")
# What the mission did next, by the decisions of mission.jsonl.
DECISION_WORDS = {
    "begin": "began another round", "choose": "went on with the next brick or view", "plan_clear": "planned the arm out of view",
    "clear": "moved the arm out of view", "look": "looked again", "detect": "detected the bricks again", "report": "told the choice of views",
    "plan_pick": "planned a pick", "pick": "picked", "plan_stow": "planned to stow", "stow": "stowed", "let_go": "let the brick go",
    "select": "chose another view", "drive": "drove", "recover": "recovered the arm", "wait": "waited", "unload": "was unloaded", "halting": "stopped arm and base",
    "paused": "paused", "held": "held still", "idle": "waited for a start", "ended": "ended the mission",
}
END_WORDS = {
    "no_brick_left": "all bricks are picked and nothing stands above the ground",
    "bricks_exhausted": "every brick that is left has used up its attempts",
    "nothing_worth_going": "no place to stand was worth going to, or what is left was not seen any more",
    "no_progress": "view after view brought neither a pick nor a new brick",
    "time_up": "the time was up",
    "stopped": "the operator stopped it",
    "needs_person": "a person must check the robot",
    "brick_in_hand": "a brick in the hand could not be stowed",
    "planning_failed": "planning the arm failed again and again",
    "arm_failed": "the arm failed again and again",
    "picks_failed": "picks failed again and again",
    "looks_failed": "no new image came into the map",
    "detection_failed": "the detection of bricks failed again and again",
    "selection_failed": "the choice of a view failed again and again",
    "drives_failed": "drives failed again and again",
    "recovery_failed": "the arm could not be recovered",
    "not_ready": "what it waited for did not come",
}


def loads(text):
    """json.loads() that raises ValueError, too, for what is nested so deeply that nobody could walk through it."""
    try:
        level = [value := json.loads(text)]
    except RecursionError:
        raise ValueError("nested too deeply") from None
    for _ in range(MAX_DEPTH):
        level = [inner for outer in level if isinstance(outer, (dict, list)) for inner in (outer.values() if isinstance(outer, dict) else outer)]
    if level:
        raise ValueError("nested too deeply")
    return value


def read_json(path, notes):
    try:
        value = loads(path.read_text(encoding="utf-8", errors="replace"))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        notes.append(f"{path.name} cannot be read: {error}")
        return {}
    if not isinstance(value, dict):
        notes.append(f"{path.name} holds no object")
        return {}
    return value


def read_lines(path, notes):
    """Objects of a JSON Lines file; what cannot be read is left out and noted."""
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        notes.append(f"{path.name} is missing")
        return []
    rows, broken = [], []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            row = loads(line)
            if not isinstance(row, dict):
                raise ValueError("no object")
            rows.append(row)
        except ValueError:
            broken.append(number)
    if broken == [len(lines)]:
        notes.append(f"{path.name}: the last line is cut off")
    elif broken:
        notes.append(f"{path.name}: {len(broken)} of {len(lines)} lines cannot be read, the first is line {broken[0]}")
    if not rows and not broken:
        notes.append(f"{path.name} is empty")
    return rows


def cells_of(path):
    """[[cell]] of a CSV file that has no quotes. Not by the csv module: that ends at a long run of NUL bytes, as a power cut leaves it."""
    return [line.split(",") for line in path.read_text(encoding="utf-8", errors="replace").splitlines() if line]


def read_table(path, notes):
    """{column: [finite number or nan]} of judge.csv without the digest, time_s always a number; a last line that is cut off is left out."""
    try:
        header, *lines = cells_of(path)
    except OSError:
        notes.append(f"{path.name} is missing")
        return {}
    except ValueError:
        lines = []
    if not lines:
        notes.append(f"{path.name} is empty")
        return {}
    rows = []
    for cells in lines:
        try:
            row = {name: number(float(cell or "nan")) for name, cell in zip(header, cells) if name != "digest"}
        except ValueError:
            continue
        if len(cells) == len(header) and math.isfinite(row.get("time_s", 0.0)):
            rows.append(row)
    if len(rows) < len(lines):
        notes.append(f"{path.name}: {len(lines) - len(rows)} of {len(lines)} rows cannot be read")
    return {name: [row[name] for row in rows] for name in header if name != "digest"}


def number(value, default=math.nan):
    """A finite float, or the default."""
    try:
        return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value) else default
    except OverflowError:  # an int of hundreds of digits
        return default


def measure_of(value):
    """A finite float, or None."""
    return number(value, None)


def count_of(value):
    """An int from 0 on, or None."""
    value = number(value, -1.0)
    return int(value) if value >= 0.0 else None


def read_origin(path):
    """{"command", "date", "host", "commit", "software", "configuration", "machine"} that scripts/run_mission has left; earlier versions left less."""
    try:
        command, *lines = path.read_text(encoding="utf-8", errors="replace").splitlines() or [""]
    except OSError:
        return {}
    pairs = (line.partition(": ") for line in lines)
    found = {"command": command.strip(), **{key: value.strip() for key, _, value in pairs if key in ("date", "host", "commit", "software", "configuration", "machine")}}
    return {key: value for key, value in found.items() if value}


def pose_of(value):
    """(x [m], y [m], yaw [rad]), or None."""
    numbers = [number(entry) for entry in value] if isinstance(value, list) else []
    return tuple(numbers) if len(numbers) == 3 and all(map(math.isfinite, numbers)) else None


class Run:
    """origin: command, date, host and commit of the run, as far as they are known; folder, notes: sentences about what is missing; summary: the mission's; judge: judge.json; table: judge.csv;
    events, log, selections: lines; bricks: of mission_state.json; world_pictures, maps: [(seconds, count, path)];
    is_simulated: or a robot's, which has no judge; is_one_of_several: missions of a run, whose judge, table, events and pictures are cut to it."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder)
        self.notes = []
        self.summary = read_json(self.folder / "summary.json", self.notes)
        # The second mission of a run is in mission_2, and so on; the judge's files are of them all.
        above = self.folder.resolve().parent
        has_name = re.fullmatch(r"mission_[0-9]+", self.folder.resolve().name) is not None
        is_later = has_name and (above / "judge.csv").exists() and not (self.folder / "judge.csv").exists()
        whole = above if is_later else self.folder
        self.is_one_of_several = is_later or (self.folder / "mission_2").is_dir()
        self.is_simulated = any((whole / name).exists() for name in (".run_mission", "judge.csv", "judge.json", "events.jsonl"))
        self.origin = read_origin(whole / ".run_mission")
        self.judge = read_json(whole / "judge.json", self.notes)
        self.table = read_table(whole / "judge.csv", self.notes if self.is_simulated else [])
        self.events = read_lines(whole / "events.jsonl", [])
        self.log = [row for row in read_lines(self.folder / "mission.jsonl", self.notes) if math.isfinite(number(row.get("time_s")))]
        self.path = [row for row in read_lines(self.folder / "path.jsonl", []) if math.isfinite(number(row.get("time_s"))) and pose_of(row.get("base"))]
        self.selections = [row for row in read_lines(self.folder / "selections.jsonl", self.notes) if isinstance(row.get("segments"), list)]
        self.bricks = self._bricks(read_json(self.folder / "mission_state.json", self.notes))
        self.world_pictures = self._pictures(whole, "world", "png")
        self.maps = self._pictures(whole, "map", "ply")
        if self.is_simulated and not (whole / "judge.json").exists():
            self.notes.append("judge.json is missing: " + ("the number of bricks is not known" if self.is_one_of_several else
                                                           "the simulator did not end by itself" + ("; its totals are from judge.csv" if self.table else "")))
        if self.is_one_of_several:
            self._cut_to_mission()

    def _cut_to_mission(self):
        """Cuts the data of a run down to this mission: counts begin with it, areas of the whole run are left out."""
        begin_s, end_s = (number(self.log[index]["time_s"]) for index in (0, -1)) if self.log else (math.inf, -math.inf)
        times = self.table.get("time_s", [])
        # From the last row before it: what happens makes a row at once, the first within may have counted already.
        first = max((index for index, time_s in enumerate(times) if time_s <= begin_s), default=0)
        rows = [index for index, time_s in enumerate(times) if index >= first and time_s <= end_s]
        self.table = {name: [column[index] for index in rows] for name, column in self.table.items()}
        before = {name: column[0] for name, column in self.table.items() if column}
        for name in {"stowed", "falls", "dropped", "collisions", "load_contacts", "distance_m"} & set(before):
            self.table[name] = [round(value - before[name], 3) for value in self.table[name]]
        self.judge = {"bricks_total": number(self.judge.get("bricks_total")) - before.get("stowed", math.nan)}
        self.events = [event for event in self.events if begin_s <= number(event.get("time_s")) <= end_s]
        self.world_pictures, self.maps = ([entry for entry in entries if begin_s <= entry[0] <= end_s] for entries in (self.world_pictures, self.maps))

    def _bricks(self, state):
        """The ledger of bricks, wherever in the mission's saved state it is."""
        if isinstance(state.get("bricks"), list):
            return [brick for brick in state["bricks"] if isinstance(brick, dict) and "id" in brick]
        for value in state.values():
            if isinstance(value, dict):
                found = self._bricks(value)
                if found:
                    return found
        return []

    @staticmethod
    def _pictures(folder, kind, suffix):
        pattern = re.compile(rf"{kind}_([0-9]+(?:\.[0-9]+)?)_([0-9]+)\.{suffix}")
        found = []
        for path in (folder / "pictures").glob(f"{kind}_*.{suffix}"):
            match = pattern.fullmatch(path.name)
            if match:
                found.append((float(match.group(1)), int(match.group(2)), path))
        return sorted(found)

    def start_s(self):
        """ROS time at which the run began."""
        if self.table.get("time_s"):
            return self.table["time_s"][0]
        begun = [number(row["time_s"]) for row in self.log]
        return number(self.judge.get("start_time_s"), begun[0] if begun else 0.0)

    def clock(self):
        return "simulated time" if self.is_simulated else "time"

    def mission_begun_s(self):
        """ROS time at which the mission was started."""
        for row in self.log:
            if row.get("event") == "start":
                return number(row["time_s"])
        return number(self.log[0]["time_s"]) if self.log else self.start_s()

    def periods(self):
        """[(from_s, to_s, activity index)]: what the mission did when. An event comes in the state that it ends."""
        periods, previous_s = [], None
        activity_of = {state: index for index, (_, states) in enumerate(ACTIVITIES) for state in states}
        for row in self.log:
            time_s = number(row["time_s"])
            index = activity_of.get(str(row.get("state")))
            if previous_s is not None and time_s > previous_s and index is not None:
                if periods and periods[-1][2] == index and periods[-1][1] == previous_s:
                    periods[-1] = (periods[-1][0], time_s, index)
                else:
                    periods.append((previous_s, time_s, index))
            previous_s = time_s if previous_s is not None or row.get("event") == "start" else None
        return periods

    def failed_rows(self):
        """Yields (row, how many failures the mission counted with it, the brick it was about or None)."""
        before, brick = 0, None
        for row in self.log:
            failures = count_of(row.get("failures"))
            if failures is not None and failures > before:
                yield row, failures - before, brick if row.get("state") in ABOUT_A_BRICK else None
            before = before if failures is None else failures
            named = re.search(r"\bbrick (\d{1,9})\b", str(row.get("reason", ""))) if row.get("decision") == "plan_pick" else None
            brick = int(named.group(1)) if named else brick

    def failures(self):
        """[(kind, times, seconds of the last, why, {what it did then: times})] the most frequent first; from the log if it has them. All that
        the mission counts, also that it found no pile when the last brick was picked."""
        found = {}
        for row, count, _ in self.failed_rows():
            kind = f"{row.get('state', '?')}: {row.get('event', '?')}"
            times, _, _, then = found.get(kind, (0, 0.0, "", {}))
            decision = DECISION_WORDS.get(str(row.get("decision")), str(row.get("decision", "?")))
            found[kind] = (times + count, number(row["time_s"]), str(row.get("reason", "")), {**then, decision: then.get(decision, 0) + 1})
        counted = self.summary.get("failures")
        for kind, times in (counted.items() if isinstance(counted, dict) else ()):
            found[str(kind)] = (count_of(times) or 0, *found.get(str(kind), (0, math.nan, "", {}))[1:])
        return sorted(((kind, *entry) for kind, entry in found.items()), key=lambda entry: (-entry[1], entry[0]))

    def exceptions(self):
        """failures() without the criterion of success: "no pile" of the choice of views ends a mission that has picked all."""
        last = self.log[-1] if self.log else {}
        is_success = self.summary.get("end_reason", "no_brick_left") == "no_brick_left" and last.get("decision") == "ended"
        criterion = f"{last.get('state')}: {last.get('event')}" if is_success and last.get("event") == "no pile" else None
        rest = ((kind, times - (kind == criterion), *entry) for kind, times, *entry in self.failures())
        return [entry for entry in rest if entry[1] > 0]

    def plans_failed(self):
        """{brick: plans to pick it that failed in the whole mission}. The mission's own count restarts with each pick."""
        found = {}
        for row, count, brick in self.failed_rows():
            if row.get("state") == "plan_pick" and brick is not None:
                found[brick] = found.get(brick, 0) + count
        return found

    def standing_poses(self):
        """[(ROS time [s], (x [m], y [m], yaw [rad]))] at which a drive ended well: as measured, else as the log tells its goal."""
        found, goal = [], None
        for row in self.log:
            time_s = number(row["time_s"])
            if row.get("state") == "drive" and row.get("event") == "success":
                measured = [pose_of(line["base"]) for line in self.path if number(line["time_s"]) <= time_s]
                if measured or goal:
                    found.append((time_s, measured[-1] if measured else goal))
            told = re.search(r"at \((-?[\d.]+), (-?[\d.]+)\) m, (-?[\d.]+) rad", str(row.get("reason", ""))) if row.get("decision") == "drive" else None
            try:
                goal = pose_of([float(value) for value in told.groups()]) if told else goal
            except ValueError:  # 1.2.3
                pass
        return found


def memory_of(folder):
    """{node: {"most_mb", "early_mb", "late_mb", "hours"}} of memory.csv: the most at any time, medians of the second and the last
    quarter of the mission, and the simulated time between their middles. The first quarter is left out: buffers fill and the map grows to the size of its scene."""
    import statistics
    sizes = {}
    try:
        header, *lines = cells_of(folder / "memory.csv")
    except (OSError, ValueError):
        return {}
    for cells in lines:
        row = dict(zip(header, cells))
        try:
            node, time_s, size = row["node"], number(float(row["time_s"])), number(float(row["resident_mb"]))
        except (KeyError, ValueError):
            continue  # cut off
        if math.isfinite(time_s) and math.isfinite(size):
            sizes.setdefault(node, []).append((time_s, size))
    found = {}
    for node, rows in sorted(sizes.items()):
        begin_s, end_s = rows[0][0], rows[-1][0]

        def median(low, high, rows=rows, begin_s=begin_s, length_s=end_s - begin_s):
            within = [size for time_s, size in rows if low <= (time_s - begin_s) / length_s <= high]
            return statistics.median(within) if within else math.nan

        if end_s - begin_s > 0.0:
            early, late = median(0.25, 0.5), median(0.75, 1.0)
            if math.isfinite(early) and math.isfinite(late):
                found[node] = {"most_mb": max(size for _, size in rows), "early_mb": round(early, 1), "late_mb": round(late, 1),
                               "hours": round(0.5 * (end_s - begin_s) / 3600.0, 4)}
    return found


def precision_with_bricks(run):
    """The mean of the map's precision while a brick was there: where the last is gone all that a map holds, a crumb, is false.
    One moment would tell little: in the seconds after a pick the map still holds the brick."""
    values = [value for value in run.table.get("precision", []) if value > 0.0]
    return round(sum(values) / len(values), 5) if values else None


def merged_summary(run):
    """The mission's summary with the judge's figures; figures that nobody told are null."""
    summary = dict(run.summary)
    last = run.log[-1] if run.log else {}
    for key in ("bricks_picked", "bricks_exhausted", "picks_begun", "views"):
        summary.setdefault(key, last.get(key))
    for key in ("scene", "seed", "strategy", "removed_factor", "end_reason", "end_message", "sim_seconds", "wall_seconds"):
        summary.setdefault(key, None)
    for key in ("scene", "strategy", "removed_factor", "end_reason", "end_message"):
        if not isinstance(summary[key], (str, type(None))):
            run.notes.append(f"summary.json: {key} is no text")
            summary[key] = None
    if "failures" not in summary:
        summary["failures"] = {kind: times for kind, times, *_ in run.failures()}
    if summary["sim_seconds"] is None and run.log:
        summary["sim_seconds"] = round(number(last["time_s"]) - run.mission_begun_s(), 3)
    if summary["end_reason"] in (None, "none"):  # the mission keeps its summary at each step, before it has ended with "none"
        summary["end_reason"] = "crashed" if run.log or run.table else None

    def judged(key, column=None):
        if key in run.judge:
            return run.judge[key]
        values = [value for value in run.table.get(column or key, []) if math.isfinite(value)]
        return values[-1] if values else None

    for key, (name, column) in {"bricks_stowed": ("stowed", None), "falls": ("falls", None), "drops": ("dropped", None),
                                "collisions": ("collisions", None), "load_contacts": ("load_contacts", None)}.items():
        summary[key] = count_of(judged(name, column))
    for key, name in {"map_coverage": "coverage", "map_precision": "precision", "distance_m": "distance_m", "disturbance_m": "disturbance_m"}.items():
        summary[key] = measure_of(judged(name))
    # What an ideal camera on the mast, everywhere at once, would have seen of what was exposed.
    exposed_m2, coverable_m2 = number(run.judge.get("exposed_area_m2"), 0.0), number(run.judge.get("coverable_area_m2"), -1.0)
    summary["map_coverable"] = measure_of(coverable_m2 / exposed_m2) if exposed_m2 > 0.0 and coverable_m2 >= 0.0 else None
    precision = precision_with_bricks(run)
    if precision is not None:
        summary["map_precision"] = precision
    if count_of(run.judge.get("bricks_total")) is not None:
        summary["bricks_total"] = count_of(run.judge["bricks_total"])
    summary.setdefault("bricks_total", None)
    summary["bricks_pickable"] = count_of(run.judge.get("bricks_pickable"))
    summary["deciding_factors"] = deciding_factors(run.selections)
    summary["memory"] = memory_of(run.folder)
    summary["origin"] = run.origin
    return summary


def weights_of(selections):
    """The weights of eq 15's sum, found from the logged factors and their sums; None if the log does not tell them.

    Each segment is one equation, information = sum of weight * factor, and they were computed with the same weights.
    """
    import numpy as np
    rows, sums = [], []
    for selection in selections:
        for segment in selection["segments"]:
            if not isinstance(segment, dict):
                continue
            row = [number(segment.get(name + "_factor")) for name in FACTORS]
            information = number(segment.get("information"))
            if np.all(np.isfinite(row)) and math.isfinite(information):
                rows.append(row)
                sums.append(information)
    if len(rows) < len(FACTORS):
        return None
    matrix, sums = np.array(rows), np.array(sums)
    weights, _, rank, _ = np.linalg.lstsq(matrix, sums, rcond=1e-6)
    # 1e-3: what a few decimals in the log make of it. More, and the sum is another.
    if rank < len(FACTORS) or np.abs(matrix @ weights - sums).max() > 1e-3 or weights.min() < -1e-3:
        return None
    return dict(zip(FACTORS, (float(weight) for weight in weights)))


def deciding_factors(selections):
    """{factor: share of the choices in which another view would have been chosen without it}; {} if the log does not tell the weights."""
    import numpy as np
    weights = weights_of(selections)
    if weights is None:
        return {}
    moved, count = dict.fromkeys((*FACTORS, "failure_penalty"), 0), 0
    for selection in selections:
        segments = [segment for segment in selection["segments"] if isinstance(segment, dict) and segment.get("verdict") == 0]
        if selection.get("outcome") != 0 or len(segments) < 2:
            continue
        count += 1
        information, penalty = (np.array([number(segment.get(key)) for segment in segments]) for key in ("information", "failure_penalty"))
        chosen = np.argmax((1 - penalty) * information)
        for name, weight in weights.items():
            without = information - weight * np.array([number(segment.get(name + "_factor")) for segment in segments])
            moved[name] += int(np.argmax((1 - penalty) * without) != chosen)
        moved["failure_penalty"] += int(np.argmax(information) != chosen)
    return {name: round(times / count, 3) for name, times in moved.items()} if count else {}


def duration(seconds):
    """75.4 -> "1:15 min"."""
    if seconds is None or not math.isfinite(number(seconds)):
        return "?"
    seconds = int(round(seconds))
    if seconds >= 3600:
        return f"{seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d} h"
    return f"{seconds // 60}:{seconds % 60:02d} min"
