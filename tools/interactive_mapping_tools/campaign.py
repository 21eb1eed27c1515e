# SPDX-License-Identifier: BSD-3-Clause
"""Runs the missions of a definition file in the simulated world, as many at a time as cores allow, and prints their tables.

  scripts/campaign [options] [-- OPTION OF SNAKEMAKE ...]

It can be interrupted: the next call runs what is missing. On another machine, --recorded takes what was counted before. A mission counts if it has ended by itself, on this state of the software,
with these arguments, and no node restarted, no input was stale and no answer was given up. Others are run again, up to three times a call.
Exit code: 0 all missions count; 1 some do not, each is named; 2 bad usage.
"""

import fcntl
import itertools
import json
import pathlib
import re
import shlex
import shutil
import signal
import sys
from importlib import metadata

import yaml

from . import ROOT, mission_run, run_mission, table_campaign, workspace
from .cli import Parser, Refusal, UsageError, one_line_errors

FILES = ROOT / "tools/campaign"
STALE = re.compile(r'"event": *"(stale [a-z]+|STALE_[A-Z]+|MONITOR_GONE|HEARTBEAT_LOST)"')
NODE_ENDED = re.compile(r"\[([^\]\s]+)\] process has (?:died|finished)")
GIVEN_UP = "this run cannot be repeated exactly"  # simulated_world: an answer did not come


def parse(words):
    split = words.index("--") if "--" in words else len(words)
    parser = Parser(__doc__)
    parser.add_argument("--definition", type=pathlib.Path, default=FILES / "paper.yaml", metavar="FILE", help="cycles, variants and tables (default tools/campaign/paper.yaml)")
    parser.add_argument("--scenes", metavar='"A B"', help="only these of the definition's")
    parser.add_argument("--seeds", metavar='"1 2 3"', help="in place of the definition's, for pilots")
    parser.add_argument("--out", default="results/campaign", metavar="DIR", help="folder, absolute or relative to the repository (default %(default)s)")
    parser.add_argument("--recorded", type=pathlib.Path, metavar="DIR",
                        help="folder with missions.csv and curves.csv of an earlier campaign, such as docs/results/figures, absolute or relative to the repository: what counts there is not run again")
    parser.add_argument("--list", action="store_true", help="print each mission and its state, run nothing")
    parser.add_argument("--table", action="store_true", help="print the tables of what counts, run nothing")
    parser.add_argument("--no-build", action="store_true", help="install and build nothing: the workspace is built already")
    parser.add_argument("--prefix", default="", metavar='"COMMAND"', help='before each mission\'s command, such as "apptainer exec /shared/mission.sif"')
    parser.add_argument("--mission", metavar="NAME", help="run this one of DIR/campaign.json here: what Snakemake calls")
    options = parser.parse_args(words[:split])
    options.snakemake, options.out = words[split + 1:] or ["--profile", str(FILES / "local")], ROOT / options.out
    if options.recorded is not None:
        options.recorded = ROOT / options.recorded
        if options.recorded.resolve() == options.out.resolve():  # its files are written anew, with what is asked for
            raise UsageError(f"--recorded {options.recorded} is the folder of --out, must be another")
        for name in ("missions.csv", "curves.csv"):
            if not (options.recorded / name).is_file():
                raise UsageError(f"--recorded {options.recorded} has no {name}, must hold missions.csv and curves.csv")
    return options


def merged(first, second):
    """Trees of parameters; where both have a value, that of the second."""
    if not (isinstance(first, dict) and isinstance(second, dict)):
        return second
    return {**first, **{key: merged(first[key], value) if key in first else value for key, value in second.items()}}


def words_of(scene, seed, cycle, variant, definition, options):
    """For run_mission. A file of parameters is relative to the definition's folder; those of a cycle and a variant are made one, in --out."""
    arguments = {**definition["cycles"][cycle], **definition["variants"][variant]}
    files = [options.definition.resolve().parent / of["params"] for of in (definition["cycles"][cycle], definition["variants"][variant]) if "params" in of]
    if len(files) == 2:
        trees = [yaml.safe_load(file.read_text(encoding="utf-8")) for file in files]
        files = [options.out / f"{cycle}-{variant}.yaml"]
        options.out.mkdir(parents=True, exist_ok=True)
        files[0].write_text(yaml.safe_dump(merged(*trees)), encoding="utf-8")
    if files:
        arguments["params"] = str(files[0])
    chosen = [word for key in ("strategy", "removed_factor") if key in arguments for word in ("--" + key.replace("_", "-"), arguments.pop(key))]
    return ["--scene", scene, "--seed", seed, "--time-limit", f"{definition['time_limit_s'][scene]:g}", "--wall-limit", str(definition["wall_limit_s"]), "--no-page", *chosen,
            *(["--", *(f"{key}:={value}" for key, value in arguments.items())] if arguments else [])]


def missions_of(options):
    """{name: what it is, its command and the fingerprints that its result has to have}, in the order of the seeds. Raises UsageError."""
    lists = {name: given and given.split() for name, given in (("scenes", options.scenes), ("seeds", options.seeds))}
    for name, given in lists.items():
        if given == []:
            raise UsageError(f"--{name} is empty")
    try:
        definition = yaml.safe_load(options.definition.read_text(encoding="utf-8"))
        cells = dict.fromkeys((scene, cycle, variant, str(seed)) for table in definition["tables"].values() for seed in lists["seeds"] or table["seeds"]
                              for scene in table["scenes"] for cycle in table["cycles"] for variant in table["variants"]
                              if lists["scenes"] is None or scene in lists["scenes"])
        commands = {(scene, cycle, variant, seed): words_of(scene, seed, cycle, variant, definition, options)
                    for scene, cycle, variant, seed in sorted(cells, key=lambda cell: cell[3].zfill(10))}  # the seeds one by one: a part of a campaign is balanced
    except (KeyError, TypeError, AttributeError, ValueError, OSError, yaml.YAMLError) as error:
        raise UsageError(f"{options.definition}: {table_campaign.words_of(error)}") from error
    if not commands:
        raise UsageError(f"{options.definition} has no mission" + (f" in {options.scenes}" if options.scenes else ""))
    software, parsed, found = workspace.software(), {}, {}
    if software == "unknown":
        raise UsageError("git does not report the state of src and sim_tests: results could not be distinguished")
    for cell, words in commands.items():
        folder = options.out / "-".join(cell)
        if not workspace.is_seed(cell[3]):
            raise UsageError(f"seed {cell[3]}, must be a whole number in [0, {workspace.MAX_SEED}]")
        if cell[:3] not in parsed:  # the seed changes nothing in what it refuses
            parsed[cell[:3]] = run_mission.parse(["--run", str(folder), "--overwrite", *words])
        mission_options, arguments = parsed[cell[:3]]
        mission_options.seed = cell[3]
        command = [*shlex.split(options.prefix), str(ROOT / "scripts/run_mission"), "--run", str(folder), "--overwrite", *words]
        found[folder.name] = {**dict(zip(table_campaign.CELL, cell)), "folder": str(folder), "command": command, "software": software,
                              "configuration": workspace.configuration(run_mission.arguments_of(mission_options, arguments))}
    if options.recorded:
        add_recorded(options.recorded, found)
    return found


def add_recorded(folder, missions):
    """Gives the missions that count there their rows of missions.csv and curves.csv, as "row" and "curve". Raises Refusal if a file is not whole."""
    table_campaign.read_rows(folder / "missions.csv")
    try:
        rows = {table_campaign.cell_of(row): row for row in table_campaign.read_csv(folder / "missions.csv")}
        curves = {cell: list(of_cell) for cell, of_cell in itertools.groupby(table_campaign.read_csv(folder / "curves.csv"), table_campaign.cell_of)}
        for name, mission in missions.items():
            row = rows.get(table_campaign.cell_of(mission))
            if row and any(row[key] != mission[key] for key in ("software", "configuration")):
                print(f"campaign: {name}: recorded of commit {row['commit']}, another state or configuration", file=sys.stderr)
            elif row:
                curve = curves[table_campaign.cell_of(mission)]
                if abs(float(curve[-1]["bricks"]) - 100.0 * float(row["bricks_stowed"]) / float(row["bricks_total"])) > 0.001:  # its last digit
                    raise ValueError(f"{name} ends with {curve[-1]['bricks']} % of the bricks, in missions.csv with {row['bricks_stowed']}")
                mission.update(row={key: row[key] for key in table_campaign.COLUMNS}, curve=curve)
    except table_campaign.BROKEN as error:
        raise Refusal(f"{folder / 'curves.csv'}: {table_campaign.words_of(error)}") from error


def state_of(mission):
    """(why the result does not count, None if it does; its summary, None if it is recorded)."""
    if "row" in mission:
        return None, None
    folder = pathlib.Path(mission["folder"])

    def text_of(name):
        return (folder / name).read_text(encoding="utf-8", errors="replace")

    try:
        summary = table_campaign.checked(mission_run.loads(text_of("summary.json")))
        origin = summary["origin"]
        if origin["software"] != mission["software"]:
            return f"stale: of commit {origin.get('commit')}", summary
        if origin["configuration"] != mission["configuration"]:
            return "stale: of another configuration", summary
        log, launch, _ = text_of("mission.jsonl"), text_of("log/roslaunch.log"), text_of("judge.csv")
        table_campaign.curve_of(folder, summary["bricks_total"])
    except FileNotFoundError as error:
        return "missing" if error.filename.endswith("summary.json") else f"broken: no {pathlib.Path(error.filename).name}", None
    except (OSError, *table_campaign.BROKEN) as error:
        return f"broken: {table_campaign.words_of(error)}", None
    if re.search('"decision": *"ended"', log) is None:
        return "the mission did not end by itself", summary
    for pattern, words in ((STALE, "stale input"), (NODE_ENDED, "a node ended")):
        match = pattern.search(log if pattern is STALE else launch)
        if match:
            return f"{words}: {match.group(1)}", summary
    return ("an answer was given up" if GIVEN_UP in launch else None), summary


def run(mission):
    """The exit code of the Snakefile's rule: if it is 1, Snakemake runs the mission again."""
    workspace.run_child(mission["command"])
    problem, _ = state_of(mission)
    if problem:
        print(f"campaign: {pathlib.Path(mission['folder']).name}: {problem}", file=sys.stderr)
    return 1 if problem else 0


def check_built(software):
    """Raises UsageError if the workspace was built of another state; one that was built otherwise does not tell."""
    built = ROOT / "devel/.software"
    if built.exists() and built.read_text(encoding="utf-8").strip() != software:
        raise UsageError(f"devel/ was built of state {built.read_text(encoding='utf-8').strip()}, src, sim_tests and examples are of {software}: build again, or leave out --no-build")


def check_snakemake():
    try:
        version = metadata.version("snakemake")
    except metadata.PackageNotFoundError:
        raise UsageError("Snakemake is missing: apt-get install --no-install-recommends snakemake") from None
    if not (7, 7) <= tuple(int(number) for number in version.split(".")[:2]) < (8, 0):
        raise UsageError(f"Snakemake {version} is installed, must be 7.7 or a later 7: Debian 12 has it")


def run_all(options, missions):
    """Snakemake's marks say what counts; it runs all missions without one. Its own lock would outlive a killed process, ours does not."""
    (options.out / "complete").mkdir(parents=True, exist_ok=True)
    lock = (options.out / "lock").open("w")
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        raise UsageError(f"another campaign runs in {options.out}, must be one at a time") from None
    for name, mission in missions.items():
        mark = options.out / "complete" / name
        if state_of(mission)[0]:
            mark.unlink(missing_ok=True)
        else:
            mark.touch()
    shutil.rmtree(options.out / ".snakemake/incomplete", ignore_errors=True)  # an interrupted Snakemake would run them again; the marks tell
    command = shlex.join([sys.executable, str(ROOT / "tools/run"), "campaign", "--out", str(options.out)])
    (options.out / "campaign.json").write_text(json.dumps({"command": command, "missions": missions}), encoding="utf-8")
    before = signal.signal(signal.SIGINT, lambda *_: None)  # Ctrl-C reaches Snakemake and the missions, too, which end in order
    workspace.run_child([sys.executable, "-m", "snakemake", "--snakefile", str(FILES / "Snakefile"), "--directory", str(options.out), "--configfile",
                         str(options.out / "campaign.json"), "--rerun-triggers", "mtime", "--nolock", "--retries", "2", "--keep-going", "--scheduler", "greedy",
                         "--log-handler-script", str(FILES / "progress.py"), *options.snakemake])
    signal.signal(signal.SIGINT, before)
    lock.close()


def report(options, missions):
    """Writes missions.csv, its tables and curves.csv, prints the tables; the exit code."""
    rows, curves = [], []
    for name, mission in missions.items():
        problem, summary = state_of(mission)
        if problem:
            print(f"campaign: {name}: {problem}", file=sys.stderr)
        else:
            rows.append(mission.get("row") or table_campaign.row_of(mission, summary))
            curves += mission.get("curve") or table_campaign.curve_rows_of(mission, summary["bricks_total"])
    if rows:
        options.out.mkdir(parents=True, exist_ok=True)
        table_campaign.write_csv(options.out / "missions.csv", table_campaign.COLUMNS, rows)
        table_campaign.write_csv(options.out / "curves.csv", table_campaign.CURVE_COLUMNS, curves)
        table_campaign.print_tables(options.out / "missions.csv")
    print(f"\n{len(rows)} of {len(missions)} missions count", flush=True)
    return 0 if len(rows) == len(missions) else 1


@one_line_errors
def main():
    options = parse(sys.argv[1:])
    if options.mission is not None:
        workspace.end_in_order()
        missions = json.loads((options.out / "campaign.json").read_text(encoding="utf-8"))["missions"]
        return run(missions[options.mission])
    missions = missions_of(options)
    if options.list:
        for name, mission in missions.items():
            print(f"{name}: {state_of(mission)[0] or ('counts, recorded' if 'row' in mission else 'counts')}")
        return 0
    if not options.table:
        if options.no_build:
            check_built(workspace.software())
        else:
            workspace.library("install_packages; install_packages campaign; build_workspace all")
        check_snakemake()
        workspace.end_in_order()
        run_all(options, missions)
    return report(options, missions)
