# The fast tests as other machines might run them; sourced by .ci/run. All variations are run, or
# those that are named; one that fails makes the end non-zero.
names=("$@")
[[ $# -gt 0 ]] || names=(moved python threads oldest newer)
failed=()

environment() { # NAME PYTHON [PIP ARGUMENT...]
    local folder=$work/$1 python=$2
    shift 2
    "$python" -m venv "$folder"
    "$folder/bin/pip" install --quiet --disable-pip-version-check --no-compile "$@" -e '.[test]'
}

try() { # NAME PYTHON-OF-ENVIRONMENT [PYTEST ARGUMENT...]; variables of the environment go before it
    local name=$1 python=$2
    shift 2
    step "$name"
    XDG_CACHE_HOME=$work/cache-$name PYTHONPATH=.ci "$python" -m pytest -q -p no:cacheprovider "$@" ||
        failed+=("$name")
}

plain=$work/plain/bin/python
environment plain "$python"
for name in "${names[@]}"; do
    case $name in
    moved) # numbers and the order of tests, see elsewhere.py, and what the compiler does; sweeps
        # know scenes by their numbers, and ticks are exact
        CC=$PWD/.ci/cc try moved "$plain" -p elsewhere -n 4 --ignore tests/families \
            --ignore tests/systems/spiked/test_ticks.py \
            --deselect tests/reports/test_report_parts.py::test_a_sweep_as_it_was_computed_opens \
            --deselect "tests/project/test_docstrings.py::test_examples_run[wormopt.families.sweep]" ;;
    python) # no compiler
        CC=none try python "$plain" ;;
    threads) # in the libraries, and one process
        OMP_NUM_THREADS=4 OPENBLAS_NUM_THREADS=4 try threads "$plain" -n 0 ;;
    oldest) # of what pyproject.toml allows
        "$python" - > "$work/oldest.txt" <<'PYTHON'
import tomllib

with open("pyproject.toml", "rb") as file:
    project = tomllib.load(file)["project"]
for needed in project["dependencies"] + project["optional-dependencies"]["test"]:
    name, _, oldest = needed.partition(">=")
    print(f"{name}=={oldest}{'' if '.' in oldest else '.0'}.*")
PYTHON
        environment oldest "$python" -c "$work/oldest.txt" || { failed+=(oldest) && continue; }
        # which warn of each other
        try oldest "$work/oldest/bin/python" -o filterwarnings=default ;;
    newer) # versions of Python, where they are installed
        for newer in python3.12 python3.13 python3.14; do
            "$newer" -c "" 2> /dev/null || continue
            environment "$newer" "$newer" || { failed+=("$newer") && continue; }
            try "$newer" "$work/$newer/bin/python"
        done ;;
    *) echo "no variation $name" >&2; exit 2 ;;
    esac
done
printf '\nfailed: %s\n' "${failed[*]:-none}"
[[ ${#failed[@]} -eq 0 ]]
