from wormopt.systems.coils.scenes.material import SIScene as SIScene
