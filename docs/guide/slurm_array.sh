#!/bin/sh
# A batch of pictures on a Slurm cluster, a part a task:
#
#   sbatch --array=1-8 slurm_array.sh shots.json pictures
#
# What was cut off is begun again by the same line: pictures that are there are left. Of an array of which only some tasks are begun again
# (--array=3,5), PARTS tells how many there were: PARTS=8 sbatch --array=3,5 ...
#SBATCH --job-name=transplat
#SBATCH --cpus-per-task=1
#SBATCH --requeue
set -eu
export RAYON_NUM_THREADS="${SLURM_CPUS_PER_TASK:-1}"
exec transplat render --batch "$1" --output "$2" --part "$SLURM_ARRAY_TASK_ID/${PARTS:-$SLURM_ARRAY_TASK_COUNT}" ${OPTIONS:-}
