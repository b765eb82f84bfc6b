#!/usr/bin/env bash
# Installs the add-on's zip in a Blender with a window, clicks through a bake and takes screenshots of each step.
#
#   tests/blender/gui/run.sh BLENDER_ROOT ZIP OUT
#
# In: the root folder of a system (chroot) that has Blender 4.2 or later, a zip of blender_addon/build.py, a folder for
# the pictures. Needs Xvfb and ImageMagick's `import` in that system, and the right to chroot. Exit code 0 if all went well.
set -eu
root=$1 zip=$(readlink -f "$2") out=$3 here=$(cd "$(dirname "$0")" && pwd)
display=${DISPLAY_NUM:-98}
work=$root/tmp/lightkiln_gui
rm -rf "$work" && mkdir -p "$work/home" "$out"
cp "$zip" "$work/lightkiln.zip"
cp "$here/drive.py" "$work/"

inside() {
  chroot "$root" env HOME=/tmp/lightkiln_gui/home DISPLAY=":$display" LIBGL_ALWAYS_SOFTWARE=1 LP_NUM_THREADS=2 "$@"
}

inside blender --command extension install-file -r user_default -e /tmp/lightkiln_gui/lightkiln.zip
Xvfb ":$display" -screen 0 1280x900x24 +extension GLX -noreset > /dev/null 2>&1 &
server=$!
trap 'kill $server 2> /dev/null || true' EXIT
sleep 1
code=0
inside timeout 480 blender --factory-startup --enable-event-simulate --window-geometry 0 0 1280 900 \
  --python /tmp/lightkiln_gui/drive.py -- /tmp/lightkiln_gui/shot || code=$?
cp "$work"/shot_*.png "$out/" || true
exit $code
