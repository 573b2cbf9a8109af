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
rm -f held joined server.pid data/postmaster.pid
printf '%s\n' "$description" >description

{
    "$@" &
    echo $! >server.pid
    wait $!
    rm -f description held joined server.pid
    [ "$socket_directory" = "$home" ] || rmdir "$socket_directory"
    echo "ended $$" 1<>alive # wakes the loop below, also when the server crashed while it has users
} 3<&- &
serving=$!

server=
# The server's process may not have been begun yet; while what begins it is there, it will be.
find_server() {
    while [ -z "$server" ] && kill -0 "$serving"; do read -r server <server.pid || sleep 0.01; done 2>/dev/null
}
trap 'kill -INT "$server"' TERM
while read -r command token <&3; do
    find_server
    case $command in
        hold) [ -p alive ] && exec 4>alive && : >held ;; # a user of our own: the server stays until release
        release) exec 4>&- && rm -f held ;;
        ended) [ "$token" = $$ ] && break ;;
    esac
    echo "$token" >joined
done
find_server
kill -INT "$server" 2>/dev/null
# A server that has only just begun does not hear it yet: say it again until it is gone.
(while sleep 1 && kill -INT "$server" 2>/dev/null; do :; done) 3<&- 4>&- &
again=$!
wait "$serving"
kill "$again" 2>/dev/null || :
