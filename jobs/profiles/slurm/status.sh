#!/usr/bin/env bash
# Says how a Slurm job is, in Snakemake's words. scontrol and not sacct: many clusters keep no
# accounts, and scontrol knows finished jobs for some minutes (MinJobAge).
state=$(scontrol show job "$1" 2>/dev/null | grep -oE 'JobState=[A-Z_]+' | head -n 1 | cut -d= -f2)
if [ -z "$state" ]; then
  state=$(sacct -n -X -P -j "$1" -o State 2>/dev/null | head -n 1 | cut -d' ' -f1)
fi
case "$state" in
  COMPLETED) echo success ;;
  PENDING | CONFIGURING | RUNNING | SUSPENDED | COMPLETING | REQUEUED | RESIZING | STOPPED | SIGNALING) echo running ;;
  *) echo failed ;;
esac
