#!/bin/sh
# Makes again the touch model of the DIGIT that comes with palpate: scripts/train_digit_model.sh FOLDER
# An hour on two cores. Weights may differ in the last digits from one processor to another.
set -eu
data=$1
palpate simulate "$data/train" --count 90 --seed 1 --seconds 10 --workers 2 --ideal
palpate simulate "$data/train" --shape rectangle --count 110 --seed 4 --seconds 10 --workers 2 --resume --ideal
palpate simulate "$data/test" --count 30 --seed 2 --workers 2 --ideal
palpate train "$data/train" --test "$data/test" --out "$data/model" --seed 0 --workers 2
