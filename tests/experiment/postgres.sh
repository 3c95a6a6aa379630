#!/usr/bin/env bash
# A PostgreSQL server on this machine, for tests; it listens to a socket in its folder only.
#
#   postgres.sh start DIR    make it in DIR and start it
#   postgres.sh stop DIR     end it
#
# Debian: apt-get install postgresql
set -euo pipefail
action=$1
dir=$(realpath -m "$2")
bin=$(ls -d /usr/lib/postgresql/*/bin 2>/dev/null | tail -n 1 || true)
bin=${bin:-$(dirname "$(command -v initdb)")}

# PostgreSQL refuses to run as root.
as_owner() {
    if [ "$(id -u)" = 0 ]; then
        setpriv --reuid=postgres --regid=postgres --clear-groups "$@"
    else
        "$@"
    fi
}

case $action in
start)
    mkdir -p "$dir"
    [ "$(id -u)" = 0 ] && chown postgres: "$dir"
    as_owner "$bin/initdb" --pgdata="$dir/data" --username=tester --auth=trust --no-sync >/dev/null
    as_owner "$bin/pg_ctl" --pgdata="$dir/data" --log="$dir/log" --wait \
        --options="-c listen_addresses='' -c unix_socket_directories='$dir'" start >/dev/null
    ;;
stop)
    as_owner "$bin/pg_ctl" --pgdata="$dir/data" --mode=immediate stop >/dev/null
    ;;
*)
    echo "usage: $0 start|stop DIR" >&2
    exit 2
    ;;
esac
