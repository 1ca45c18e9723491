#!/bin/sh
# Trains the GelSight Mini's touch model from nothing, and studies it on pushes by other units with an exact and with a
# real set-up: scripts/train_gelsight_mini_model.sh FOLDER. Three hours on two cores; weights differ with the processor.
set -eu
data=$1
mkdir -p "$data"
printf 'x,y\n0.04532,0\n0,0.02113\n-0.04532,0\n0,-0.02113\n' > "$data/rhombus50.csv" # angles of 50 and 130 degrees
printf 'x,y\n0.03967,0\n0,0.03044\n-0.03967,0\n0,-0.03044\n' > "$data/rhombus75.csv" # 75 and 105
options="--sensor gelsight-mini --seconds 5 --workers ${WORKERS:-2} --resume --ideal"
rhombi="--shape $data/rhombus50.csv --shape $data/rhombus75.csv --shape-unit m"
palpate simulate "$data/train" --shape disc --shape ellipse --count 100 --seed 41 $options
palpate simulate "$data/train" $rhombi --count 150 --seed 42 $options || test $? -eq 3 # some topple
palpate simulate "$data/train" --shape rectangle --count 400 --seed 43 $options
palpate simulate "$data/test" --count 21 --seed 2 $options
palpate train "$data/train" --test "$data/test" --out "$data/model" --seed 0 --steps 4000 --workers "${WORKERS:-2}"
for set_up in real ideal; do
    is_ideal=$(test "$set_up" = ideal && echo --ideal || true)
    options="--sensor gelsight-mini --seed 761 --seconds 10 --workers 2 --resume $is_ideal"
    palpate simulate "$data/$set_up" --shape disc --shape ellipse --count 50 $options
    palpate simulate "$data/$set_up" --shape rectangle --count 150 $options
    rm -f "$data/$set_up"/*corners* # on a flat pad these are not what the model is good for
    palpate evaluate "$data/$set_up" --out "$data/results-$set_up" --tactile learnt --model "$data/model" --workers 2
done
