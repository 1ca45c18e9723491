#!/bin/sh
# Trains a touch model of the DIGIT as the one that comes with palpate was trained: scripts/train_digit_model.sh FOLDER
# An hour on two cores. The weights will be others: those that come along had learnt key points without labels first, in
# earlier code. With this code every line was tried on a few recordings of three seconds, and never in full.
set -eu
data=$1
palpate simulate "$data/train" --count 90 --seed 1 --seconds 10 --workers 2 --ideal
palpate simulate "$data/train" --shape rectangle --count 110 --seed 4 --seconds 10 --workers 2 --resume --ideal
palpate simulate "$data/test" --count 30 --seed 2 --workers 2 --ideal
palpate train "$data/train" --test "$data/test" --out "$data/model" --seed 0 --workers 2
