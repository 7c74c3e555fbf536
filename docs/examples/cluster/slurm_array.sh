#!/bin/bash
#SBATCH --array=1-20
#SBATCH --cpus-per-task=4
#SBATCH --mem=18G
#SBATCH --requeue
#SBATCH --open-mode=append
# sbatch slurm_array.sh ARCHIVE RESULTS
shards=20 # the tasks of the whole array, also when only some of them are submitted again
exec analyze batch "$1" --out "$2" --shard "$SLURM_ARRAY_TASK_ID/$shards" --jobs "$SLURM_CPUS_PER_TASK"
