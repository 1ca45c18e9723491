#!/bin/sh
# Trains a touch model of the DIGIT from nothing: scripts/train_digit_model.sh FOLDER
# An hour on two cores; a GPU is used where there is one. The weights that come with palpate are others: on these
# recordings they continue those of earlier code, which had learnt key points without labels first, and are the mean
# after two descents. scripts/measure_touch_model.py FOLDER/test judges them.
set -eu
data=$1
mkdir -p "$data"
printf 'x,y\n0.04532,0\n0,0.02113\n-0.04532,0\n0,-0.02113\n' > "$data/rhombus50.csv" # angles of 50 and 130 degrees
printf 'x,y\n0.03967,0\n0,0.03044\n-0.03967,0\n0,-0.03044\n' > "$data/rhombus75.csv" # 75 and 105
options="--seconds 10 --workers 2 --ideal --resume"
rhombi="--shape $data/rhombus50.csv --shape $data/rhombus75.csv --shape-unit m"
palpate simulate "$data/train" --shape disc --shape ellipse --count 70 --seed 31 $options
palpate simulate "$data/train" $rhombi --count 66 --seed 32 $options || test $? -eq 3 # some topple at the start
palpate simulate "$data/train" --shape rectangle --count 150 --seed 33 $options
palpate simulate "$data/test" --count 21 --seed 2 $options
palpate simulate "$data/test" --shape "$data/rhombus75.csv" --shape-unit m --count 12 --seed 2 $options
palpate train "$data/train" --test "$data/test" --out "$data/model" --seed 0 --workers 2
