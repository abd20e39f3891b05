from wormopt.systems.chain.build import chain as chain
from wormopt.systems.chain.runs.chains import law_of as law_of
from wormopt.systems.chain.runs.chains import laws_of as laws_of
from wormopt.systems.chain.scenes.chain import CoulombFriction as CoulombFriction
from wormopt.systems.chain.scenes.chain import Friction as Friction
from wormopt.systems.chain.scenes.chain import SpikeFriction as SpikeFriction
from wormopt.systems.chain.scenes.chain import ViscousFriction as ViscousFriction
from wormopt.systems.chain.scenes.chain import faults_of_law as faults_of_law
