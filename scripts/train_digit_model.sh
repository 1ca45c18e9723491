#!/bin/sh
# Trains the touch model of the DIGIT that comes with palpate from nothing: scripts/train_digit_model.sh FOLDER
# An hour on two cores. Weights differ from one processor to another.
set -eu
data=$1
mkdir -p "$data"
printf 'x,y\n0.04532,0\n0,0.02113\n-0.04532,0\n0,-0.02113\n' > "$data/rhombus50.csv" # angles of 50 and 130 degrees
printf 'x,y\n0.03967,0\n0,0.03044\n-0.03967,0\n0,-0.03044\n' > "$data/rhombus75.csv" # 75 and 105
options="--workers ${WORKERS:-2} --ideal --resume"
rhombi="--shape $data/rhombus50.csv --shape $data/rhombus75.csv --shape-unit m"
palpate simulate "$data/train" --shape disc --shape ellipse --count 150 --seed 31 --seconds 5 $options
palpate simulate "$data/train" $rhombi --count 150 --seed 32 --seconds 5 $options || test $? -eq 3 # some topple
palpate simulate "$data/train" --shape rectangle --count 450 --seed 33 --seconds 5 $options
palpate simulate "$data/test" --count 42 --seed 3 --seconds 10 $options
palpate simulate "$data/test" --shape "$data/rhombus75.csv" --shape-unit m --count 24 --seed 3 --seconds 10 $options
palpate train "$data/train" --test "$data/test" --out "$data/model" --seed 0 --workers "${WORKERS:-2}"
