# Makes HOME/data under a temporary name first, so that a data directory is complete or absent. Run by /bin/sh as its owner.
#
#   initialise.sh HOME BIN DURABLE(yes|no)
set -eu
home=$1 bin=$2 durable=$3
umask 077
cd "$home"
rm -rf data.new
sync_option=
[ "$durable" = yes ] || sync_option=--no-sync
"$bin/initdb" -D "$home/data.new" -A trust -U postgres -E UTF8 --locale=C $sync_option
cat >data.new/conflictdb.conf
echo "include = 'conflictdb.conf'" >>data.new/postgresql.conf
printf '%s\n' 'CREATE DATABASE conflictdb' 'CREATE ROLE planner LOGIN' |
    "$bin/postgres" --single -D "$home/data.new" postgres
mv data.new data
