#!/bin/sh
# Trains the touch model of the GelSight Mini that comes with palpate anew, and studies it on pushes by other units, with
# an exact set-up and with the errors of a real one: scripts/train_gelsight_mini_model.sh FOLDER
# Two hours on two cores. Weights may differ in the last digits from one processor to another.
set -eu
data=$1
palpate simulate "$data/train" --sensor gelsight-mini --count 60 --seed 1 --seconds 6 --workers 2 --resume --ideal
palpate train "$data/train" --out "$data/model" --steps 2500
for set_up in real ideal; do
    is_ideal=$(test "$set_up" = ideal && echo --ideal || true)
    options="--sensor gelsight-mini --seed 761 --seconds 10 --workers 2 --resume $is_ideal"
    palpate simulate "$data/$set_up" --shape disc --shape ellipse --count 50 $options
    palpate simulate "$data/$set_up" --shape rectangle --count 150 $options
    rm -f "$data/$set_up"/*corners* # on a flat pad these are not what the model is good for
    palpate evaluate "$data/$set_up" --out "$data/results-$set_up" --tactile learnt --model "$data/model" --workers 2
done
