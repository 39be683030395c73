#!/bin/sh
# Name every missing system tool with the Debian/Ubuntu command that installs it; end with 1 if one is missing.
# Usage: check_tools.sh PYTHON [test]
python=$1
missing=0

need() { # what it is, the package that has it
    echo "eskin needs $1; install it with: apt-get install $2" >&2
    missing=1
}

command -v g++ >/dev/null || need "g++" "g++"
command -v perl >/dev/null || need "perl" "perl"
[ "$2" != test ] || command -v iverilog >/dev/null || need "iverilog (Icarus Verilog, for the tests)" "iverilog"
if ! command -v "$python" >/dev/null; then
    need "Python 3.11 or newer ($python is not there)" "python3 python3-venv python3-dev"
elif ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
    need "Python 3.11 or newer ($python is $("$python" -V 2>&1)), then make PYTHON=python3.11" "python3.11 python3.11-venv python3.11-dev"
else
    "$python" -c 'import venv, ensurepip' 2>/dev/null || need "Python's venv and ensurepip modules" "python3-venv"
    "$python" - <<'PY' 2>/dev/null || need "Python's shared library (cocotb loads it into the simulator)" "python3-dev"
import ctypes, os, sysconfig
names = [sysconfig.get_config_var("INSTSONAME"), "libpython" + sysconfig.get_python_version() + ".so.1.0"]
for name in names:
    for path in (name, os.path.join(sysconfig.get_config_var("LIBDIR"), name)):
        try:
            ctypes.CDLL(path)
        except OSError:
            continue
        raise SystemExit(0)
raise SystemExit(1)
PY
fi
exit $missing
