#!/usr/bin/env bash
# Bring a backup back into an empty database and an empty artifact folder. Usage: restore.sh FOLDER/STAMP.dump
#
# Stop the API and every worker first. The database of NERFMODAL_DATABASE_URL must exist and be empty.
set -euo pipefail

dump=${1:?usage: restore.sh FOLDER/STAMP.dump}
database=${NERFMODAL_DATABASE_URL:?say which database}
database=${database/+psycopg/}

tables=$(psql --no-align --tuples-only --command "SELECT count(*) FROM information_schema.tables WHERE table_schema = 'public'" "$database")
if [ "$tables" -ne 0 ]; then
    echo "The database is not empty: it has $tables tables. Make a new one, or drop them." >&2
    exit 2
fi
pg_restore --no-owner --exit-on-error --single-transaction --dbname="$database" "$dump"
psql --quiet --command "ANALYZE" "$database"

if [ -z "${NERFMODAL_ARTIFACT_URL:-}" ]; then
    target=${NERFMODAL_ARTIFACT_FOLDER:-${NERFMODAL_DATA_FOLDER:-.nerfmodal}/artifacts}
    mkdir -p "$target"
    cp -R --no-clobber "$(dirname "$dump")/artifacts/." "$target/"
fi
echo "Restored. Now: nerfmodal migrate, then start the API and the workers."
