#!/bin/sh
# Installs the system packages that zeromethod needs and this machine lacks: software OpenGL without a
# screen (EGL and OSMesa of Mesa) and, where Python comes without it, the venv module; with the argument
# `test` also screens (Xorg with two dummy monitors), a browser and the library of GenICam cameras (Aravis) for
# the tests. Says what it does; does nothing when all is there.
# Where it cannot install, it names the packages and goes on.
set -eu
PYTHON=${PYTHON:-python3}

has_library() { { ldconfig -p 2>/dev/null || /sbin/ldconfig -p; } | grep -q "$1"; }

missing=""
has_library libEGL.so.1 || missing="$missing libegl1"
has_library libGL.so.1 || missing="$missing libgl1 libglx-mesa0"
has_library libEGL_nvidia || [ -n "$(ls -d /usr/lib/*/dri/*_dri.so /usr/lib*/dri/*_dri.so 2>/dev/null)" ] ||
    missing="$missing libgl1-mesa-dri"
has_library libOSMesa.so || missing="$missing libosmesa6"
"$PYTHON" -c 'import ensurepip, venv' 2>/dev/null || missing="$missing python3-venv"
if [ "${1:-}" = test ]; then
    command -v Xorg >/dev/null 2>&1 || missing="$missing xserver-xorg-core"
    [ -n "$(ls /usr/lib/xorg/modules/drivers/dummy_drv.so 2>/dev/null)" ] || missing="$missing xserver-xorg-video-dummy"
    command -v xrandr >/dev/null 2>&1 || missing="$missing x11-xserver-utils"
    command -v ffprobe >/dev/null 2>&1 || missing="$missing ffmpeg"
    command -v chromium >/dev/null 2>&1 || command -v google-chrome >/dev/null 2>&1 || missing="$missing chromium"
    has_library libaravis-0.8.so.0 || missing="$missing libaravis-0.8-0"
fi
[ -z "$missing" ] && exit 0

cannot() {
    echo "system packages are missing here, and $1; ask for:$missing" >&2
    case "$missing" in *libegl1* | *libgl1* | *libosmesa6*)
        echo "without them software OpenGL comes as a wheel, too: .venv/bin/pip install --no-deps lavavu-osmesa" >&2 ;;
    esac
    exit 0
}

command -v apt-get >/dev/null 2>&1 || cannot "there is no apt-get (elsewhere they have other names)"
sudo=""
if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null 2>&1 || cannot "only root may install them, without sudo"
    sudo="sudo"
fi
echo "installing system packages:$missing" >&2
said=$(mktemp)
$sudo apt-get update -qq >"$said" 2>&1 || cat "$said" >&2
# One at a time: newer Debian releases no longer carry every one of them (OSMesa), and EGL alone is enough.
for package in $missing; do
    DEBIAN_FRONTEND=noninteractive $sudo apt-get install -y -qq --no-install-recommends "$package" >"$said" 2>&1 ||
        echo "could not install $package; going on without it ($(tail -n 1 "$said"))" >&2
done
rm -f "$said"
