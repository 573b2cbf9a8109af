#!/usr/bin/env bash
# Proves every way to the embedded database on fresh systems, which tests on one machine cannot.
#
#   sudo tests/fresh_systems/embedded_database.sh [DIRECTORY [CASE...]]
#
# As root, on Debian or Ubuntu with debootstrap; needs 2 GB in DIRECTORY (default: a new temporary one, removed in the
# end) and some 5 minutes. The systems come from this machine's own archive and are of its own release, or of RELEASE (a
# code name). Each case works on a throw-away overlay, in namespaces of its own: what it mounts and starts ends with it.
set -euo pipefail

repository=$(cd "$(dirname "${BASH_SOURCE[0]}")/../.." && pwd)

# In a case: what a user of the database sees, then whether anything is left when the user is gone.
use_database='
import sys, time
from pathlib import Path
import psycopg
from conflictdb import embedded as server
from conflictdb.errors import ServerError
began = time.monotonic()
try:
    embedded = server.embedded(say=print)
except ServerError as error:
    sys.exit(f"{error}\nafter {time.monotonic() - began:.1f} s")
with embedded, psycopg.connect(embedded.dsn) as conn:
    conn.execute("CREATE EXTENSION IF NOT EXISTS postgis")
    conn.execute("CREATE EXTENSION IF NOT EXISTS btree_gist")
    print(*conn.execute("SELECT ST_AsText(ST_Transform(ST_Point(7, 46, 4326), 3395), 3)").fetchone())
    owner = Path("/proc", str(embedded.status().pid)).owner()
    print(f"server of user {owner}, after {time.monotonic() - began:.1f} s")
'

inside() { # SYSTEM WORK NETWORK USER PREPARE COMMAND...: runs in its own mount and process namespace
    local system=$1 work=$2 network=$3 user=$4 prepare=$5
    shift 5
    mkdir -p "$work"/{upper,work,root}
    mount -t overlay overlay -o "lowerdir=$system,upperdir=$work/upper,workdir=$work/work" "$work/root"
    enter_mounts "$work/root"
    [ -z "$prepare" ] || chroot "$work/root" /bin/sh -ec "$prepare" >"$work/prepare.log" 2>&1
    local net=()
    [ "$network" = yes ] || net=(unshare --net)
    "${net[@]}" chroot --userspec="$user" "$work/root" /usr/bin/env -C /src HOME="/home/$user" "$@" || echo "exit code $?"
    for _ in $(seq 100); do pgrep -x postgres >/dev/null || break; sleep 0.05; done
    if pgrep -x postgres >/dev/null; then echo "LEFT RUNNING"; fi
}

enter_mounts() { # ROOT: what a system needs of the machine: processes, devices, names, certificates
    mount -t proc proc "$1/proc"
    mount --bind /dev "$1/dev"
    mount -t tmpfs tmpfs "$1/dev/shm"
    for file in /etc/resolv.conf /etc/hosts; do cp -L "$file" "$1$file"; done
    if [ -d /etc/ssl/certs ]; then mount --bind /etc/ssl/certs "$1/etc/ssl/certs"; fi
}

if [ "${1-}" = --inside ]; then
    shift
    inside "$@"
    exit
fi

directory=${1:-$(mktemp -d)}
[ $# -gt 0 ] || trap 'rm -rf "$directory"' EXIT
cases=" ${*:2} "
mkdir -p "$directory"
chmod 755 "$directory"
failed=0

apart() { unshare --mount --pid --fork --kill-child --mount-proc "$0" --inside "$@"; }

make_system() { # a minimal system with the checkout and its environment, made by ./run as an ordinary user
    local system own_release release mirror
    system=$(. /etc/os-release && echo "${ID^}")
    own_release=$(. /etc/os-release && echo "$VERSION_CODENAME")
    release=${RELEASE:-$own_release}
    # shellcheck disable=SC2016 # the fields are apt's, not the shell's
    mirror=$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' "Origin: $system" "Codename: $own_release" | head -n 1)
    : "${mirror:?apt knows no archive of this system: apt-get update}"
    debootstrap --variant=minbase --include=python3,python3-venv,ca-certificates "$release" "$directory/base.part" "$mirror" \
        >"$directory/debootstrap.log"
    chroot "$directory/base.part" useradd --create-home alice
    mkdir -p "$directory/base.part/src" "$directory/base.part/home/root"
    git -C "$repository" archive HEAD | tar -x -C "$directory/base.part/src"
    chroot "$directory/base.part" chown -R alice: /src
    mv "$directory/base.part" "$directory/base"
}

prove() { # NAME NETWORK USER PREPARE EXPECTED: EXPECTED is what the output must match
    local name=$1 network=$2 user=$3 prepare=$4 expected=$5 log="$directory/$1.log"
    shift 5
    [[ $cases = "  " || $cases = *" $name "* ]] || return 0
    rm -rf "${directory:?}/$name"
    apart "$directory/ready" "$directory/$name" "$network" "$user" "$prepare" "$@" .venv/bin/python -c "$use_database" \
        >"$log" 2>&1 || true
    if grep -Eq -- "$expected" "$log" && ! grep -q 'LEFT RUNNING' "$log"; then
        echo "ok      $name: $(grep -Eo 'after [0-9.]+ s' "$log" | tail -n 1)"
    else
        echo "FAILED  $name: expected $expected"
        sed 's/^/        /' "$log"
        failed=1
    fi
    rm -rf "${directory:?}/$name"
}

if [ ! -d "$directory/base" ]; then make_system; fi
if [ ! -d "$directory/ready" ]; then
    rm -rf "$directory/venv"
    apart "$directory/base" "$directory/venv" yes alice '' ./run test --version
    cp -a "$directory/base" "$directory/ready.part"
    cp -a "$directory/venv/upper/src/.venv" "$directory/ready.part/src/.venv"
    mv "$directory/ready.part" "$directory/ready"
fi

install='export DEBIAN_FRONTEND=noninteractive; apt-get update; apt-get install -y --no-install-recommends'
# shellcheck disable=SC2016 # expanded in the case
# One that nobody answers for (a network for documentation), one whose name is nobody's, one that was misspelt.
dead_sources='for at in http://198.51.100.1/silent http://nowhere.invalid/unknown $(. /etc/os-release; echo "$HOME_URL")missing; do
    echo "deb $at stable main"; done >/etc/apt/sources.list.d/dead.list'
used='POINT\(779236\.436 5749599\.546\)'

for user in root alice; do
    prove "no-server-$user" yes "$user" '' 'fetched: .*cache/conflictdb/'
    prove "without-postgis-$user" yes "$user" "$install postgresql" 'fetched: .*cache/conflictdb/'
    prove "with-postgis-$user" no "$user" "$install postgresql-postgis" 'machine: /usr/lib/postgresql/'
    prove "no-network-$user" no "$user" '' 'No PostgreSQL .* was found'
done
prove answers yes alice '' "$used"
prove no-download yes alice '' 'turned off by CONFLICTDB_NO_DOWNLOAD' CONFLICTDB_NO_DOWNLOAD=1
prove dead-sources yes alice "$dead_sources" "$used"
prove empty-home yes alice '' "$used" HOME=
prove root-serves-as-postgres no root "$install postgresql-postgis" 'server of user postgres'
prove root-serves-as-nobody yes root '' 'server of user nobody'
exit $failed
