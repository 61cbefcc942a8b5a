#!/usr/bin/env bash
# SPDX-License-Identifier: MIT
# The Debian package: built in a root of Debian 13 and installed there, among nothing but what it depends on, then
# used by the short program and by the command on a scene file, with few elements. Called by `make test-deb`. All
# happens in a layer that is thrown away. Another suite may be named: install/test_deb.sh sid
set -euo pipefail

clone=$(cd -- "$(dirname -- "${BASH_SOURCE[0]}")/.." && pwd -P)
if [ "${1:-}" != inside ]; then
    "$clone/install/debian_root.sh" "${1:-trixie}" make setup # a root that is set up already stays as it is
    exec "$clone/install/debian_root.sh" --layer "${1:-trixie}" install/test_deb.sh inside
fi

export DEBIAN_FRONTEND=noninteractive
cd "$clone"
rm -rf .venv # the package must find nothing of it
apt-get -q update
apt-get -q install -y --no-install-recommends build-essential
apt-get -q build-dep -y --no-install-recommends ./
dpkg-buildpackage --build=binary --no-sign
package=(../python3-dolfinx-ffr_*.deb)
apt-get -q install -y --no-install-recommends "${package[0]}"
# What other tests have installed goes, unless the package depends on it.
apt-mark showmanual | grep -xF -f <(sed 's/#.*//; s/|/ /g' install/debian-packages*.txt | tr -s ' ' '\n' | grep .; echo build-essential) |
    xargs apt-mark auto >/dev/null
apt-get -q -o APT::AutoRemove::RecommendsImportant=false autoremove -y --purge >/dev/null
echo "deb: installed with $(dpkg-query -f '.\n' -W | wc -l) packages on $(. /etc/os-release && echo "$PRETTY_NAME")"

away=$(mktemp -d)
for test in short-program scene-file; do AUTOPKGTEST_TMP=$away debian/tests/$test; done
apt-get -q purge -y python3-dolfinx-ffr >/dev/null
left=$(find /usr /etc -path '*dolfinx_ffr*' -print -quit)
[ -z "$left" ] || { echo "deb: $left stays behind when the package is removed" >&2; exit 1; }
echo "deb: built, installed, used and removed"
