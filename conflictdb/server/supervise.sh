# Runs one PostgreSQL server for as long as somebody uses it. Run by /bin/sh as the owner of the data directory.
#
#   supervise.sh HOME SOCKET_DIRECTORY DESCRIPTION POSTGRES [ARGUMENT...]        standard input: the read end of HOME/alive
#
# Every user holds HOME/alive open for writing, so end-of-file means that the last one has gone, kill -9 included.
# A user joins with a line `COMMAND TOKEN` and is in once HOME/joined holds its token: a line that is written after
# end-of-file was seen is never answered, so nobody mistakes a server that is about to stop for one that stays.
# The read end stays open until the server is down; whoever holds the other end sees then that it is gone.
home=$1 socket_directory=$2 description=$3
shift 3
cd "$home" || exit 1
umask 077
trap '' HUP INT QUIT
exec 3<&0 </dev/null >>server.log 2>&1
rm -f held joined
printf '%s\n' "$description" >description

# The server, and the end of this script when the server ends: at our request, or by a crash.
{
    "$@" 3<&- &
    echo $! >server.pid
    wait $!
    rm -f server.pid description held joined
    case $socket_directory in "$home") ;; *) rmdir "$socket_directory" ;; esac
    kill -KILL $$
} &

trap 'kill -INT "$(cat server.pid)"' TERM
while read -r command token <&3; do
    case $command in
        hold) exec 4>alive && : >held ;; # a user of our own: the server stays until release
        release) exec 4>&- && rm -f held ;;
    esac
    echo "$token" >joined
done
kill -INT "$(cat server.pid)"
wait
