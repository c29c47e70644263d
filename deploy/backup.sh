#!/usr/bin/env bash
# Back a service up: the database first, then the artifacts. Usage: backup.sh FOLDER
#
# Order matters: whatever the dump refers to was stored before it was taken, and nothing that is referred to is removed
# within a day, so artifacts copied after the dump hold everything that the dump knows. Works while the service runs.
#
# NERFMODAL_DATABASE_URL (postgresql…) and NERFMODAL_ARTIFACT_FOLDER say what is backed up. With NERFMODAL_ARTIFACT_URL the
# artifacts are in an object store: let it keep versions or replicate, and only the database is backed up here.
set -euo pipefail

folder=${1:?usage: backup.sh FOLDER}
database=${NERFMODAL_DATABASE_URL:?say which database}
database=${database/+psycopg/}
case $database in
postgresql*) ;;
*) echo "Only PostgreSQL: an SQLite service is backed up by copying its data folder while it is stopped." >&2 && exit 2 ;;
esac

mkdir -p "$folder"
stamp=$(date -u +%Y%m%dT%H%M%SZ)
pg_dump --format=custom --no-owner --file="$folder/.$stamp.part" "$database"
mv "$folder/.$stamp.part" "$folder/$stamp.dump"

if [ -z "${NERFMODAL_ARTIFACT_URL:-}" ]; then
    source=${NERFMODAL_ARTIFACT_FOLDER:-${NERFMODAL_DATA_FOLDER:-.nerfmodal}/artifacts}
    mkdir -p "$folder/artifacts"
    # Names are digests: a file that is there already is the same. Read-only copies, never links: a rotten disk block
    # under the service must not rot the backup.
    (cd "$source" && find . -type f -not -path './.staging/*' -print0) |
        while IFS= read -r -d '' name; do
            [ -e "$folder/artifacts/$name" ] && continue
            mkdir -p "$folder/artifacts/$(dirname "$name")"
            cp "$source/$name" "$folder/artifacts/$name.part" && mv "$folder/artifacts/$name.part" "$folder/artifacts/$name"
        done
fi
echo "$folder/$stamp.dump"
