#!/bin/sh
# Install the missing system tools as root on Debian or Ubuntu (not with ESKIN_NO_APT=1), or else name each with the command
# that installs it; end with 1 if one is missing then.
# Usage: check_tools.sh PYTHON [test]
python=$1
for_tests=$2

need() { # the package that has it, what it is
    if [ "$naming" ]; then echo "eskin needs $2; install it with: apt-get install $1" >&2; fi
    packages="$packages $1"
}

look() { # $packages: what is missing
    packages=
    command -v g++ >/dev/null || need "g++" "g++"
    command -v perl >/dev/null || need "perl" "perl"
    [ "$for_tests" != test ] || command -v iverilog >/dev/null || need "iverilog" "iverilog (Icarus Verilog, for the tests)"
    if ! command -v "$python" >/dev/null; then
        need "python3 python3-venv python3-dev" "Python 3.11 or newer ($python is not there)"
    elif ! "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
        need "python3.11 python3.11-venv python3.11-dev" \
            "Python 3.11 or newer ($python is $("$python" -V 2>&1)), then make PYTHON=python3.11"
    else
        "$python" -c 'import venv, ensurepip' 2>/dev/null || need "python3-venv" "Python's venv and ensurepip modules"
        "$python" - <<'PY' 2>/dev/null || need "python3-dev" "Python's shared library (cocotb loads it into the simulator)"
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
}

apt() {
    echo "eskin: installs $* with apt-get, as root (ESKIN_NO_APT=1 forbids it)" >&2
    { apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq "$@"; } >/dev/null
}

may_install() {
    [ "$ESKIN_NO_APT" != 1 ] && command -v apt-get >/dev/null && command -v id >/dev/null && [ "$(id -u)" = 0 ]
}

naming=
look
if may_install; then
    # without these some tests are skipped
    wanted=
    if [ "$for_tests" = test ]; then
        command -v chromium >/dev/null && command -v chromedriver >/dev/null || wanted=" chromium chromium-driver"
        command -v sta >/dev/null || wanted="$wanted opensta"
    fi
    # shellcheck disable=SC2086 # lists of words
    [ -z "$packages$wanted" ] || apt $packages $wanted || { [ "$wanted" ] && { [ -z "$packages" ] || apt $packages; }; }
fi
naming=1
look
[ -z "$packages" ]
